# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a soak has shown, as Markdown and JSON."""

import json
import os
import platform
from dataclasses import asdict
from pathlib import Path

FIRST = 60.0  # s in which memory may grow


class Report:
    """Collects figures.

    Args:
        seed: of the messages
    """

    def __init__(self, seed: int):
        self._seed, self._load = seed, [os.getloadavg()[0]]
        self.latencies, self.faults, self.soak = [], [], None

    @property
    def problems(self) -> list[str]:
        """All that was wrong, in words."""
        found = list(self.soak.problems) if self.soak else []
        return found + [f'{one["fault"]}: {wrong}' for one in self.faults
                        for wrong in one['problems']]

    def add_latency(self, one):
        """Take a Latency."""
        self.latencies.append(one)
        self._load.append(os.getloadavg()[0])

    def add_soak(self, result):
        """Take the Result of a Soak."""
        self.soak = result
        self._load.append(os.getloadavg()[0])

    def add_fault(self, fault, problems: list, seconds: float):
        """Take what was wrong after a fault."""
        self.faults.append({'fault': fault.__name__, 'what': fault.__doc__.strip(),
                            'problems': problems, 'seconds': seconds})
        self._load.append(os.getloadavg()[0])

    def memory(self) -> dict:
        """Return memory (MB) of the node at the start, after the first minute, at most after it."""
        rows = self.soak.memory
        after = [row for row in rows if row[0] >= FIRST] or rows[-1:]
        most = max(row[1] for row in after)
        return {'at the start': rows[0][1], 'after the first minute': after[0][1],
                'most after it': most, 'at the end': rows[-1][1],
                'growth after it [%]': 100 * (most / after[0][1] - 1),
                'child, most': max((row[2] for row in rows if row[2] == row[2]),
                                   default=float('nan')),
                'descriptors': [rows[0][3], rows[-1][3]], 'threads': [rows[0][4], rows[-1][4]],
                'seconds': rows[-1][0]}

    def markdown(self) -> str:
        """Return the report."""
        lines = [f'# Soak, seed {self._seed}', '',
                 f'{os.cpu_count()} cores, {platform.machine()}, Python '
                 f'{platform.python_version()}; load average {min(self._load):.1f} to '
                 f'{max(self._load):.1f}, of which this run makes about 2.', '',
                 '## From a pose to its shape', '',
                 '| beside | poses/s | sent | answered | p50 [ms] | p99 [ms] |',
                 '|---|---|---|---|---|---|']
        lines += [f'| {one.beside} | {one.rate:g} | {one.sent} | {one.answered} | '
                  f'{one.median:.1f} | {one.late:.1f} |' for one in self.latencies]
        if self.soak is not None:
            sent, answered = self.soak.sent, self.soak.answered
            lines += ['', '## Odd messages', '',
                      f'{sum(sent.values())} messages and requests, {sum(answered.values())} '
                      f'answers, {self.soak.executions} executions.', '']
            lines += [f'* {name}: {value}' for name, value in self.memory().items()]
        lines += ['', '## Faults', '', '| what | wrong | s |', '|---|---|---|']
        lines += [f'| {one["what"]} | {"; ".join(one["problems"]) or "nothing"} | '
                  f'{one["seconds"]:.0f} |' for one in self.faults]
        lines += ['', '## Problems', '', *(f'* {one}' for one in self.problems or ['none'])]
        return '\n'.join(lines) + '\n'

    def write(self, folder: Path):
        """Write soak.md and soak.json."""
        (folder / 'soak.md').write_text(self.markdown())
        (folder / 'soak.json').write_text(json.dumps({
            'seed': self._seed, 'load': self._load, 'problems': self.problems,
            'latencies': [asdict(one) for one in self.latencies], 'faults': self.faults,
            'soak': vars(self.soak) if self.soak else None}, indent=1))
