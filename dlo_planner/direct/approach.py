# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Moving the gripper to where a step begins its search, without passing through an obstacle."""

from typing import NamedTuple

import numpy as np

from dlo_planner.direct.continuation import between
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.history import History
from dlo_planner.direct.leading import grip_at, grip_before, lead, parts_between
from dlo_planner.direct.part import Solved
from dlo_planner.direct.setting_down import set_down
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import Search, solve
from dlo_planner.energy.passage import passes_through
from dlo_planner.energy.potential import placed
from dlo_planner.model.arrays import Floats
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose

_RELAXING = 12       # Newton steps between two parts of a motion
_ROUGHLY = 1e-5      # of the length: how well obstacles are kept clear of on the way
_SMALLEST = 2.0**-14  # part of the motion: what cannot be moved by it is blocked
_MORE_PARTS = 1000   # than the longest would need: what takes more of them has got stuck


class Advanced(NamedTuple):
    """Where a search begins: gripper, strains (N, 3), the past; and whether the way is clear."""

    gripper: Pose
    strains: np.ndarray
    history: History
    clear: bool = True


def approach(discretization: Discretization, previous: Shape | None, strains: Floats, gripper: Pose,
             far_end: FarEnd | None, history: History) -> tuple[Floats, bool]:
    """Return element strains (N, 3) at `gripper` that continue `previous`, and if the way is clear.

    Arguments as `advance_boundary`.
    """
    found = advance_boundary(discretization, previous, strains, gripper, far_end, history)
    return found.strains, found.clear


def advance_boundary(discretization: Discretization, previous: Shape | None, strains: Floats,
                     gripper: Pose,
                     far_end: FarEnd | None, history: History) -> Advanced:
    """Return where the search begins, as Advanced.

    The gripper (and the far end's grip) goes straight from its pose in `previous`; the DLO gives
    way. Where an obstacle is between here and there, the motion is made in smaller parts. The past
    is `history` with the forces of the far end's grip at the end of the way.

    Parameters
    ----------
    previous : Shape or None
        Shape before. If None, the DLO is set down as it is, wherever that may be.
    strains : ndarray, shape (N, 3)
        Element strains of it on this mesh.
    history : History
        History on this mesh.
    """
    obstacles = discretization.surroundings.obstacles
    if previous is None and far_end is None or not obstacles and far_end is None:
        return Advanced(gripper, strains, history)
    strains = np.array(strains)  # those of a Shape are read-only, another type for kernels
    begin = gripper if previous is None else previous.gripper
    held = grip_before(discretization, previous, strains, begin, far_end)
    parts = parts_between(begin, gripper, held, far_end, discretization.s[-1])
    if parts == 0:
        return Advanced(gripper, strains, history)
    if previous is None and far_end is not None:
        assert held is not None  # as far_end is not
        return Advanced(*set_down(discretization, gripper, strains, (held, far_end), history,
                                  parts))
    if not obstacles and held is not None and far_end is not None:
        return Advanced(*lead(discretization, strains, (begin, gripper), (held, far_end), history,
                              parts))
    return _in_parts(discretization, strains, (begin, gripper), (held, far_end), history,
                     1.0 / parts)


def _in_parts(discretization: Discretization, strains: Floats, grippers: tuple[Pose, Pose],
              far_ends: tuple[FarEnd | None, FarEnd | None], history: History,
              longest: float) -> Advanced:
    """Return where the search begins after a way in parts, around obstacles where it can.

    Parameters
    ----------
    longest : float
        The longest part of the way.
    """
    (begin, gripper), (held, far_end) = grippers, far_ends
    done, step = 0.0, longest
    where, past, left = begin, history, round(1.0 / longest) + _MORE_PARTS
    while done < 1.0:
        old = placed(discretization.system(where.rotation), strains)
        target = min(1.0, done + step)
        there = gripper if target == 1.0 else between(begin, gripper, target)
        grip = grip_at(held, far_end, target)
        system = discretization.system(there.rotation, there.position, history, grip)
        new = placed(system, strains)
        shift = there.position - where.position
        if passes_through(system.scene, system.lengths, old.strains, old.rotations,
                          old.positions - shift, new.rotations, new.positions):
            step *= 0.5
            if step < _SMALLEST or left == 0:
                return Advanced(gripper, strains, past, False)
            continue
        done, where, left = target, there, max(left - 1, 0)
        step = min(2 * step, longest)
        if done == 1.0:
            break  # what is left is the step itself
        found = solve(discretization, system, there, new.q, history,
                      Search(_RELAXING, False, _ROUGHLY))
        strains, system = found.state.strains, found.system
        if discretization.surroundings.pinned:  # it has turned
            there, begin, gripper = (Pose.from_rotation(pose.position, system.base)
                                     for pose in (there, begin, gripper))
            where = there
        history = history.underway(Solved(discretization, system, found.state, there, grip,
                                          history.left))
    return Advanced(gripper, strains, past.leaving(hold=history.left['hold']))
