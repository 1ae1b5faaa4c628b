# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The list of all cases: kinds, how many there are of each, and their answers."""

from collections.abc import Callable
from time import process_time
from typing import NamedTuple

from benchmarks.oracle import contacts, motions, plans, refusals, shapes
from benchmarks.oracle.answers import answered
from benchmarks.oracle.given import Given


class Kind(NamedTuple):
    """How many cases there are, and the function of `Given` that returns an Answer."""

    count: int
    answer: Callable


KINDS = {
    'cold': Kind(500, shapes.cold),
    'warm': Kind(240, shapes.warm),
    'accuracy': Kind(160, shapes.accurate),
    'varying': Kind(160, shapes.varying),
    'neutral': Kind(16, shapes.neutral),
    'study': Kind(12, shapes.study),
    'track': Kind(160, shapes.tracked),
    'fall': Kind(80, shapes.falling),
    'held': Kind(200, shapes.held),
    'taut': Kind(60, shapes.taut),
    'held track': Kind(100, shapes.held_track),
    'grasped': Kind(50, shapes.grasped),
    'yielding': Kind(80, shapes.yielding),
    'many': Kind(20, shapes.many),
    'modes': Kind(60, shapes.modes),
    'sensitivity': Kind(30, shapes.sensitivity),
    'fit': Kind(10, shapes.fitted),
    'estimate': Kind(10, shapes.observed),
    'pressed': Kind(180, contacts.pressed),
    'rubbed': Kind(140, contacts.rubbed),
    'two obstacles': Kind(60, contacts.between_two),
    'corner': Kind(45, contacts.at_a_corner),
    'set down': Kind(60, contacts.set_down),
    'stepped': Kind(60, contacts.stepped),
    'idle obstacle': Kind(40, contacts.idle),
    'ordinary scene': Kind(15, contacts.ordinary),
    'held over': Kind(50, contacts.held_over),
    'grasped over': Kind(45, contacts.grasped_over),
    'yielding over a bar': Kind(40, contacts.drawn_over_a_bar),
    'motion': Kind(40, motions.free),
    'motion, idle obstacle': Kind(30, motions.idle),
    'motion in contact': Kind(30, motions.touching),
    'motion, held': Kind(24, motions.held),
    'motion, yielding': Kind(18, motions.yielding),
    'motion, held in contact': Kind(12, motions.held_touching),
    'thread': Kind(160, plans.thread),
    'thread, nested': Kind(6, plans.nested),
    'thread beside': Kind(100, plans.thread_beside),
    'thread, oblique': Kind(40, plans.thread_oblique),
    'thread two': Kind(50, plans.thread_two),
    'sequence': Kind(30, plans.sequence),
    'insert': Kind(45, plans.insert),
    'approach': Kind(24, plans.approach),
    'hold': Kind(80, plans.hold),
    'slide': Kind(40, plans.slide),
    'minimize': Kind(60, plans.minimize),
    'trajectory': Kind(8, plans.trajectory),
    'replay': Kind(24, plans.replayed),
    'robustness': Kind(12, plans.robust),
    'refusal': Kind(refusals.COUNT, refusals.refused),
}


# they go on for minutes
TOO_LONG = {('stepped', 17), ('stepped', 23), ('motion in contact', 0), ('motion in contact', 24),
            ('slide', 29)}


def solved(kind, number, shake=0):
    """Return the Answer of a case, and its CPU time in s."""
    begun = process_time()
    answer = answered(KINDS[kind].answer, Given(kind, number, shake))
    return answer, process_time() - begun
