# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What holds a DLO on its way: poses of the gripper, far ends."""

from collections.abc import Iterable, Sequence
from typing import Any

from dlo_planner.direct.guide import Grips, Guide
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, items
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose


def poses(grippers: Iterable[Pose], least: int = 0) -> tuple[Pose, ...]:
    """Return a sequence of Poses as a tuple of `least` or more; raise InvalidTask."""
    given = items('grippers', grippers, object, least=least)
    return tuple(instance(f'grippers[{index}]: gripper', gripper, Pose)
                 for index, gripper in enumerate(given))


def ends_of(far_ends: Iterable[Any] | None, count: int) -> list[FarEnd | None]:
    """Return a FarEnd, or None, for each of `count` gripper poses; raise InvalidTask."""
    if far_ends is None:
        return [None] * count
    given: tuple[Any, ...] = items('far_ends', far_ends, object)
    ends = [FarEnd.of(end) for end in given]
    if len(ends) != count:
        raise InvalidTask(f'far_ends has {len(ends)} entries: expected one per gripper pose, '
                          f'{count}')
    return ends


def moving_grips(grippers: Sequence[Pose], ends: Sequence[FarEnd | None], dt: float, at_rest: bool,
                 initial: Shape | None) -> Grips:
    """Return the smooth motion of what holds a DLO, at instants `dt` (s) apart.

    Parameters
    ----------
    at_rest : bool
        Whether everything stands still at time 0.
    initial : Shape or None
        Shape at time 0. If None, not known.

    Raises
    ------
    InvalidTask
        The far end is not held in one way from `initial` to the end.
    """
    if len({None if end is None else end.grip for end in ends}) > 1:
        raise InvalidTask('far_ends: expected the same grip from the beginning to the end of a '
                          'motion')
    if initial is not None and initial.far_end is not None and ends[0] is None:
        raise InvalidTask('initial is held at its far end: expected a Shape whose far end is '
                          'free, as it is in the motion, or far_ends')
    gripper = Guide(grippers, dt, at_rest)
    if ends[0] is None:
        return Grips(gripper)
    held = [end.pose for end in ends if end is not None]
    return Grips(gripper, Guide(held, dt, at_rest), ends[0].grip)
