# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The error of a DLO that hangs freely, and the mesh on which it is as small as is wanted.

Both come from one shape by `minimize.expected_error`, to leading order. How large the error
estimate is beside what is expected of a shape whose error is below 2e-4 of the length,
`python test/random_estimates.py` prints, without and with point masses and loads.
"""

from __future__ import annotations

from math import ceil, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.mesh import nodes_at
from dlo_planner.minimize.expected_error import foresee, resampled_means
from dlo_planner.model.arrays import Floats
from dlo_planner.model.value import freeze, put

if TYPE_CHECKING:  # it imports this package
    from dlo_planner.direct.shape import Shape

_RESOLVED = 2e-4   # of the length: an error below it is told by its leading order
_TOLD_FINER = 2e-3  # the same, on a finer mesh
_DOUBTFUL = 3.0    # times the accuracy: what is expected to be off by more is off
_STABLE = 0.1      # a shape that is less stable magnifies errors
_AIM = 0.6         # part of the accuracy that is aimed at
_MOST_ELEMENTS = 8192
_FINER = 1.2       # times as many elements at least
_FARTHEST = 20     # and at most: so far one shape tells what another mesh will do
_NEAR = 2          # Newton steps from where a shape is foreseen: with more it is another one


class Foreseen(NamedTuple):
    """What a shape on one mesh tells of the same shape on a finer one.

    Attributes
    ----------
    mesh : Discretization
        The finer one.
    strains : ndarray, shape (N, 3)
        Strains of its elements, 1/m, read-only.
    error : float
        Error of the shape there, m.
    """

    mesh: Discretization
    strains: Floats
    error: float


def expected_within(shape: Shape, accuracy: float) -> bool | None:
    """Return whether a Shape from a simulator is within an accuracy; None where that is not told.

    Parameters
    ----------
    shape : Shape
    accuracy : float
        In m.
    """
    error, mesh = _own(shape)[0], shape.state.made_on
    if error <= _RESOLVED * shape.s[-1]:
        # what acts inside an element bends that otherwise than its share on both nodes
        points = _points(mesh)
        told = shape.stability >= _STABLE and (not points.size or np.isin(points, mesh.s).all())
        return bool(error <= accuracy) if told else None
    return False if _DOUBTFUL * accuracy < error < np.inf else None


def _own(shape: Shape) -> Any:
    """Return what `foresee` does of a Shape, computed once; (infinity,) where that is not told."""
    known = shape.__dict__.get('_expected')
    if known is None:
        known = _foreseen(shape) if _told(shape) else (np.inf,)
        put(shape, _expected=known)
    return known


def _told(shape: Shape) -> bool:
    """Whether the error of a Shape comes from arcs and loads alone, and not from what varies."""
    mesh = shape.state.made_on
    return bool(mesh.hangs and shape.far_end is None and mesh.basis == 'local'
                and not mesh.rod.varies and not callable(mesh.surroundings.load)
                and shape.element_strains.shape[0] > 2)


def _points(mesh: Discretization) -> Floats:
    """Return (n,) arc lengths of point masses and loads, m."""
    loads = [one.s for one in mesh.surroundings.point_loads if one.s is not None]
    return np.array([s for s, _ in mesh.rod.point_masses] + loads)


def _foreseen(shape: Shape) -> Any:
    mesh = shape.state.made_on
    around = mesh.surroundings
    mass: Any = around.rod.mass_per_length  # nothing varies
    load: Any = np.zeros(3) if around.load is None else around.load
    spread = -mass * around.gravity - load
    return foresee(mesh.static, shape.gripper.rotation, shape.element_strains, spread)


def foreseen(shape: Shape, accuracy: float) -> Foreseen | None:
    """Return the mesh on which a Shape will be within an `accuracy` (m), and what it is there.

    None where that is not told, or no mesh is fine enough.

    Parameters
    ----------
    shape : Shape
        Shape on a coarser mesh.
    accuracy : float
        In m.
    """
    known, elements = shape.state.made_on, shape.element_strains.shape[0]
    own, *rest = _own(shape)
    if not own <= _TOLD_FINER * shape.s[-1] or elements >= _MOST_ELEMENTS:
        return None
    off, shares, one, there = rest
    most = min(_FARTHEST * elements, _MOST_ELEMENTS)
    wanted = min(max(ceil(sqrt(one / (_AIM * accuracy))), ceil(_FINER * elements)), most)
    breaks, points = known.surroundings.breaks, _points(known)
    if points.size:
        breaks = np.union1d(breaks, points)
        breaks = breaks[(breaks > 0) & (breaks < known.s[-1])]
    s = nodes_at(known.s, shares, wanted, breaks)
    mesh = Discretization(known.surroundings, s, 'local', 0)
    strains = np.empty((s.size - 1, 3))
    resampled_means(known.s, shape.element_strains - off + there / wanted**2, s, strains)
    freeze(strains)
    return Foreseen(mesh, strains, one / wanted**2)


def came_true(shape: Shape, told: Foreseen | None, accuracy: float) -> bool:
    """Return whether a Shape is what was foreseen, and that within `accuracy` (m).

    Parameters
    ----------
    shape : Shape
        Shape that was sought from the strains foreseen.
    told : Foreseen or None
    accuracy : float
    """
    if told is None or shape.iterations > _NEAR or shape.stability < _STABLE:
        return False
    return told.error <= accuracy
