# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rounds of odd messages: nothing is lost, nothing odd comes out, the answers stay the same."""

from dataclasses import dataclass, field
from time import monotonic, sleep

import numpy as np

from soak.doors import HARMLESS, SERVICES, TOPICS, Fuzzer
from soak.stage import PROOF, STEP, Stage, robot
from soak.watching import Watch, children, opened_files, resident, threads

GOOD = 0.3        # of the messages have no fault
GARBAGE = 0.05    # of those on topics are torn
FIRST = 60.0      # s in which each door is used for the first time: code is read, threads begin
LOOKS = 5         # that are told together
GROWS = 0.02      # of the memory then: what it may grow by afterwards
NAMES = (*TOPICS, *TOPICS, *SERVICES)


class NodeEnded(AssertionError):
    """The process of the node is gone; the message has the end of its log."""


@dataclass
class Result:
    """What a soak has shown.

    Attributes:
        problems: in words; none is how it should be
        sent, answered: messages by topic or service
        memory: rows of s, MB of the node, MB of its child, descriptors, threads of the node
        executions: that have run to their ends
        came: messages by topic of the node
    """

    problems: list = field(default_factory=list)
    sent: dict = field(default_factory=dict)
    answered: dict = field(default_factory=dict)
    memory: list = field(default_factory=list)
    executions: int = 0
    came: dict = field(default_factory=dict)

    def growth(self) -> float:
        """Return by which part the node's memory has grown since its first minute; nan: too short.

        The median of the last few looks tells: while it plans it has more for a moment.
        """
        settled = [row[1] for row in self.memory if row[0] >= FIRST]
        if len(settled) < 2 * LOOKS:
            return float('nan')
        return float(np.median(settled[-LOOKS:]) / np.median(settled[:LOOKS])) - 1.0


class Soak:
    """Throws messages at a Stage, in rounds.

    Args:
        stage: Stage; rng: numpy Generator
        pause: s between two messages
    """

    def __init__(self, stage: Stage, rng, pause: float = 0.002):
        self.stage, self._rng, self._pause = stage, rng, pause
        self._fuzzer, self._watch = Fuzzer(stage.client, rng), Watch(stage.client)
        self.result, self._begun = Result(), monotonic()
        self.measure()

    def round(self, number: int):
        """Throw so many messages, good and bad ones, then look whether all is as it was."""
        for _ in range(number):
            self._throw(NAMES, 0 if self._rng.random() < GOOD else self._faults())
        self._look('odd messages')

    def execution(self, least: int):
        """Execute a motion, and throw at least so many messages meanwhile that must not matter."""
        stage, thrown = self.stage, 0
        with robot(stage) as follower:
            regular = stage.execution(follower)
            end, state = monotonic() + PROOF, None
            while state is None and monotonic() < end and stage.planner.alive():
                self._throw(HARMLESS, self._faults())
                thrown += 1
                state = self._over()
        code, reason = state or (None, 'it did not end')
        moved = stage.longest_step()
        self._note(code != 0, f'an execution ended with {code}: {reason}')
        self._note(thrown < least, f'only {thrown} messages were thrown while it executed')
        self._note(not 0 < moved <= STEP * regular,
                   f'a step of {1e3 * moved:.3g} mm, where {1e3 * regular:.3g} mm is regular')
        self.result.executions += code == 0
        self._look('messages while it executed')

    def measure(self):
        """Note how much memory, how many descriptors and threads there are."""
        number = self.stage.process
        child = max((resident(one) for one in children(number)), default=float('nan'))
        self.result.memory.append((monotonic() - self._begun, resident(number), child,
                                   opened_files(number), threads(number)))

    def close(self) -> Result:
        self.result.sent, self.result.answered = self._fuzzer.sent, self._fuzzer.answered
        self.result.came = self._watch.came
        growth = self.result.growth()
        self._note(growth > GROWS, f'the memory of the node has grown by {growth:.1%}')
        self._fuzzer.close()
        self._watch.close()
        return self.result

    def _faults(self):
        return int(self._rng.integers(1, 4))

    def _throw(self, names, faults):
        name = self._fuzzer.odd.one_of(names)
        self._fuzzer.throw(name, faults, garbage=name in TOPICS and faults > 0
                           and self._rng.random() < GARBAGE)
        sleep(self._pause)

    def _over(self):
        """Return how the execution has ended, code and reason, or None."""
        messages = self.stage.client.executions
        while not messages.empty():
            status = messages.get()
            values = {item.key: item.value for item in status.values}
            if values['state'] in ('stopped', 'succeeded'):
                return int(values['code']), status.message
        return None

    def _look(self, after):
        stage, fuzzer = self.stage, self._fuzzer
        if not stage.planner.alive():
            raise NodeEnded(f'after {after} the node has ended:\n{stage.planner.log[-4000:]}')
        self._note(not fuzzer.all_answered(), f'without an answer: {fuzzer.unanswered}')
        for one in stage.differences():
            self._note(True, f'after {after}: {one}')
        self._note(self._watch.odd, f'not finite: {self._watch.odd[:5]}')
        self._note('Traceback' in stage.planner.log, 'a traceback in the log')
        self.measure()

    def _note(self, wrong, what):
        if wrong and what not in self.result.problems:
            self.result.problems.append(what)
