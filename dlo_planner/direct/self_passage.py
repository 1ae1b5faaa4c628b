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
from dlo_planner.geometry.self_passage import bends_back, passes_itself
from dlo_planner.geometry.writhe import link
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import angle_between

_TURNING = 'clamped', 'sleeve'  # grips of the far end with which it turns
_TILTS = 0.0, 1.0, -1.0  # rad: of what closes it; what swings past a grip's back passes one of them
_KNOWN = 1.0   # rad: grips that turn by more in a fall may have changed the link by a passage's


def passed_between(previous: Shape, shape: Shape, jumped: bool) -> bool | float:
    """Return the `Shape.passed_itself` of a step from `previous`, in which the DLO may have jumped.

    Where it has, nan is returned if that cannot be known.
    """
    if _bends_little(previous) and _bends_little(shape):
        return False
    if jumped and _is_turned(previous) and _is_turned(shape):
        if _turned_by(previous, shape) > _KNOWN:
            return np.nan
        changed = [abs(_link(shape, tilt) - _link(previous, tilt)) > 1.0 for tilt in _TILTS]
        return changed[0] if len(set(changed)) == 1 else np.nan
    s = np.minimum(shape.s, previous.s[-1])  # parts of a DLO that goes into a bore are shorter
    before, strains = _seen(previous, s)
    lengths = np.diff(shape.s)
    if not bends_back(lengths, strains, np.array(shape.element_strains)):
        return False
    if jumped:
        return np.nan
    return bool(passes_itself(before, _seen(shape, shape.s)[0]))


def _bends_little(shape: Shape) -> bool:
    """Whether a Shape bends by less than a right angle in all, as its energy tells."""
    mesh = shape.state.mesh
    return mesh is not None and shape.elastic_energy <= mesh.bending_back


def _seen(shape: Shape, s: Floats) -> tuple[Floats, Floats]:
    """Return places (n, 3) at arc lengths s (n,), from the gripper; strains (n - 1, 3) between."""
    if np.array_equal(s, shape.s):
        places, strains = shape.positions, shape.element_strains
    else:
        places = shape.positions_at(s)
        strains = shape.element_strains[np.clip(
            np.searchsorted(shape.s, 0.5 * (s[1:] + s[:-1])) - 1, 0, len(shape.s) - 2)]
    seen: Floats = (places - shape.positions[0]) @ shape.frames[0]
    return np.ascontiguousarray(seen), np.array(strains)


def _is_turned(shape: Shape) -> bool:
    """Whether both ends of a Shape turn with what holds them."""
    return not shape.pinned and shape.far_end is not None and shape.far_end.grip in _TURNING


def _turned_by(previous: Shape, shape: Shape) -> float:
    """Return by how much, in rad, both grips turn from a Shape to the next."""
    return sum(angle_between(previous.frames[k], shape.frames[k]) for k in (0, -1))


def _link(shape: Shape, tilt: float = 0.0) -> float:
    """Return the `link` of a Shape, in turns."""
    return float(link(*kernel_arrays(shape), tilt))
