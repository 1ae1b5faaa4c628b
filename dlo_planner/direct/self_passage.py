# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a DLO would pass through itself from one shape to the next.

The way between two shapes is taken as straight, seen from the gripper, and swept. A fall has a way
that nobody knows. Where both ends are held so that they do not turn, the link tells all the same
(`geometry.writhe`), if it does so however the DLO is closed behind its grips; where they are not,
only what cannot bend back is known not to have passed.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.direct.shape import Shape, kernel_arrays
from dlo_planner.geometry.self_passage import bends_back, passes_between
from dlo_planner.geometry.writhe import link
from dlo_planner.model.pose import angle_between
from dlo_planner.model.value import read_only

TURNING = 'clamped', 'sleeve'  # grips of the far end with which it turns
_TILTS = 0.0, 1.0, -1.0  # rad: of what closes it; what swings past a grip's back passes one of them
_KNOWN = 1.0   # rad: grips that turn by more in a fall may have changed the link by a passage's


def passed_between(previous: Shape, shape: Shape, jumped: bool) -> bool | float:
    """Return the `Shape.passed_itself` of a step from `previous`, in which the DLO may have jumped.

    Where it has, nan is returned if that cannot be known.
    """
    if bends_little(previous) and bends_little(shape):
        return False
    return has_passed(previous, shape, jumped)


def has_passed(previous: Shape, shape: Shape, jumped: bool) -> bool | float:
    """Return what `passed_between` does, where one of two Shapes may bend back."""
    swept = _is_swept(shape)
    if (jumped or swept) and _is_turned(previous) and _is_turned(shape):
        if _turned_by(previous, shape) > _KNOWN:
            return np.nan
        changed = [abs(_link(shape, tilt) - _link(previous, tilt)) > 1.0
                   for tilt in (_TILTS[:1] if swept else _TILTS)]
        # else it may have swung past the back of a grip
        return changed[0] if len(set(changed)) == 1 else np.nan
    if swept:
        return False
    if previous.s is shape.s or np.array_equal(previous.s, shape.s):
        strains, positions = previous.element_strains, previous.positions
    else:
        # parts of a DLO that goes into a bore are shorter
        s = np.minimum(shape.s, previous.s[-1])
        positions = read_only(previous.positions_at(s))
        strains = read_only(previous.element_strains[np.clip(
            np.searchsorted(previous.s, 0.5 * (s[1:] + s[:-1])) - 1, 0, len(previous.s) - 2)])
    if jumped:
        bends = bends_back(np.diff(shape.s), np.array(strains), np.array(shape.element_strains))
        return np.nan if bends else False
    return bool(passes_between(shape.s, strains, previous.frames, positions, shape.element_strains,
                               shape.frames, shape.positions))


def bends_little(shape: Shape) -> bool:
    """Whether a Shape bends by less than a right angle in all, as its energy tells."""
    mesh = shape.state.mesh
    return mesh is not None and shape.elastic_energy <= mesh.bending_back


def _is_swept(shape: Shape) -> bool:
    """Whether the search for a Shape has swept each of its steps.

    It passes neither itself nor what is straight behind its grips, but where these move.
    """
    return shape.state.mesh is not None and shape.state.mesh.touches_itself


def _is_turned(shape: Shape) -> bool:
    """Whether both ends of a Shape turn with what holds them."""
    return (not shape.pinned and shape.parts is None and shape.far_end is not None
            and shape.far_end.grip in TURNING)


def _turned_by(previous: Shape, shape: Shape) -> float:
    """Return by how much, in rad, both grips turn from a Shape to the next."""
    return sum(angle_between(previous.frames[k], shape.frames[k]) for k in (0, -1))


def _link(shape: Shape, tilt: float = 0.0) -> float:
    """Return the `link` of a Shape, in turns."""
    return float(link(*kernel_arrays(shape), tilt))
