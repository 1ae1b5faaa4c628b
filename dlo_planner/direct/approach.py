"""Moving the grippers to where a step begins its search, without passing through an obstacle."""

from dataclasses import replace

import numpy as np

from dlo_planner.direct.contacts import points_of
from dlo_planner.direct.continuation import between
from dlo_planner.direct.statics import solve
from dlo_planner.energy.passage import passes_through
from dlo_planner.energy.potential import placed
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose, angle_between

_RELAXING = 12       # Newton steps between two parts of a motion
_ROUGHLY = 1e-5      # of the length: how well obstacles are kept clear of on the way
_SMALLEST = 2.0**-14  # part of the motion: what cannot be moved by it is blocked
_TURN, _SHIFT = 0.2, 0.04  # rad, part of the length: how far a held end goes in one part


def approach(discretisation, previous, strains, gripper, far_end, history):
    """Return element strains (N, 3) at `gripper` that continue `previous`, and if the way is clear.

    The gripper (and the far end's grip) goes straight from its pose in `previous`; the DLO gives
    way. Where an obstacle is between here and there, the motion is made in smaller parts.

    Args:
        previous: Shape before, or None: then the DLO is set down as it is, wherever that may be
        strains: (N, 3) its element strains on this mesh
        history: History on this mesh
    """
    obstacles = discretisation.surroundings.obstacles
    if previous is None and far_end is None or not obstacles and far_end is None:
        return strains, True
    begin = gripper if previous is None else previous.gripper
    held = None
    if far_end is not None:
        held = _grip_before(discretisation, previous, strains, begin, far_end)
    parts = _parts(begin, gripper, held, far_end, discretisation.s[-1])
    strains = np.array(strains)  # those of a Shape are read-only, another type for kernels
    if parts == 0:
        return strains, True
    done, step = 0.0, 1.0 / parts
    where = begin
    while done < 1.0:
        old = placed(discretisation.system(where.rotation), strains)
        target = min(1.0, done + step)
        there = gripper if target == 1.0 else between(begin, gripper, target)
        grip = _grip_at(held, far_end, target)
        system = discretisation.system(there.rotation, there.position, history, grip)
        new = placed(system, strains)
        shift = there.position - where.position
        if obstacles and passes_through(
                system.scene, system.lengths, old.strains, old.rotations, old.positions - shift,
                new.positions):
            step *= 0.5
            if step < _SMALLEST:
                return strains, False
            continue
        done, where = target, there
        step = min(2 * step, 1.0 / parts)
        if done == 1.0:
            break  # what is left is the step itself
        if far_end is None:
            found = solve(discretisation, system, there, new.q, history, _RELAXING, False, _ROUGHLY)
        else:
            found = solve(discretisation, system, there, new.q, history)
        strains, system = found[0].strains, found[5]
        history = replace(history, hold=system.hold.multiplier, node_force=system.contacts.node,
                          points=points_of(system, found[0], there, False))
    return strains, True


def _grip_before(discretisation, previous, strains, begin, far_end):
    """Return the FarEnd, of the same kind, that holds the far end where it is now."""
    if previous is not None:
        end = previous.at(previous.s[-1])
    else:
        state = placed(discretisation.system(begin.rotation), strains)
        end = Pose.from_rotation(begin.position + state.positions[-1], state.rotations[-1])
    return FarEnd(end, far_end.grip)


def _grip_at(held, far_end, share):
    if far_end is None or share == 1.0:
        return far_end
    return FarEnd(between(held.pose, far_end.pose, share), far_end.grip)


def _parts(begin, gripper, held, far_end, length):
    """Return in how many parts the motion is to be made at least; 0 if there is none."""
    pairs = [(begin, gripper)]
    if far_end is not None:
        pairs.append((held.pose, far_end.pose))
    parts = 0.0
    for one, other in pairs:
        shift = np.linalg.norm(other.position - one.position)
        turn = angle_between(one.rotation, other.rotation)
        if far_end is None:
            parts = max(parts, 1.0 if shift + turn > 0 else 0.0)
        else:
            if far_end.grip == 'pinned' and one is not begin:
                turn = 0.0
            parts = max(parts, shift / (_SHIFT * length), turn / _TURN)
    return int(np.ceil(parts - 1e-9))
