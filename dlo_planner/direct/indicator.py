# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A quick bound of a shape's error, which spares the further solution of an error estimate.

`python test/random_estimates.py` prints how large the error estimate (`Shape.error_estimate`) is
beside `ritz.truncation`, for random DLOs that hang freely, are held at both ends, or touch
something: below what is taken as certain here. For DLOs that may yield it was 0.5 times (97) as
long as they have not, and 4.1 times (33) where fibers of their section had. Of ideal plasticity,
point loads, more than half a turn of natural twist, and what varies along the length it says
nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import freeze, put
from dlo_planner.ritz.truncation import truncation

if TYPE_CHECKING:  # it imports this module
    from dlo_planner.direct.shape import Shape

_FREE, _HELD, _TOUCHING, _YIELDED = 4.0, 1.5, 2.5, 8.0  # times `truncation`: the estimate is below
_STABLE = 0.1    # a shape that is less stable magnifies errors
_SURELY = 0.8   # of the accuracy: what is aimed at, so that it is not missed by little
_LIKE = 3.0      # times what the shape before lets expect: the estimate is below


def surely_within(shape: Shape, accuracy: float, mesh: Discretization | None = None) -> bool:
    """Return whether a Shape is certain to be within `accuracy` (m), without a further solution.

    Parameters
    ----------
    shape : Shape
        Shape from a simulator.
    accuracy : float
        Accuracy in m.
    mesh : Discretization, optional
        Mesh to which the shape would be transferred. If None, its own.
    """
    here = shape.state.made_on if mesh is None else mesh
    times = _times(shape, here.rod)
    if (times is None or not here.told_by_truncation
            or shape.stability < _STABLE and (shape.far_end is None or here.basis != 'local')):
        return False
    if here is shape.state.mesh:
        return bool(times * _truncated(shape) <= accuracy)
    strains = here.strains_from(shape.s, shape.element_strains)
    return bool(times * _truncation(here, strains) <= accuracy)


def hanging_surely_within(told: bool | Bools, stability: np.ndarray, truncated: np.ndarray,
                          accuracy: float | Floats) -> Bools:
    """Return (n,) what `surely_within` says of DLOs that hang freely.

    Parameters
    ----------
    told : bool or ndarray
        Whether `truncation` bounds their errors, see `Discretization.told_by_truncation`.
    stability : ndarray, shape (n,)
    truncated : ndarray, shape (n,)
        `truncation` of each, m.
    accuracy : float
        Accuracy in m.
    """
    return (stability >= _STABLE) & (_FREE * truncated <= accuracy) & told


def mode_may_be_missed(shape: Shape) -> bool:
    """Return whether a Shape may be unstable in a way that its series cannot show.

    A series that is short may well follow the shape and still not the mode in which it falls: ten
    Chebyshev terms make a straight rod under tension T L^2 = 50 EI bear 1 % too much torsion.
    """
    return bool(shape.state.made_on.basis != 'local' and shape.stability < _STABLE)


def like_before(shape: Shape, before: Shape | None, accuracy: float) -> bool:
    """Return whether a Shape is within `accuracy` (m), judged by the shape before it in a motion.

    The error estimate of the shape before has to be known already. The ratio of that estimate to
    its `truncation`, three times as large, bounds the error here. So at most every second shape of
    a motion needs a further solution.
    """
    if (before is None or shape.jumped or 'error_estimate' not in before.__dict__
            or before.state.mesh is not shape.state.mesh
            or shape.stability < _STABLE and shape.far_end is None):
        return False
    then, now = _truncated(before), _truncated(shape)
    return bool(then > 0 and _LIKE * before.error_estimate * now <= accuracy * then)


def _truncated(shape: Shape) -> float:
    """Return `truncation` of a Shape from a simulator, which is computed once."""
    known = shape.__dict__.get('_truncated')
    if known is None:
        known = _truncation(shape.state.made_on, shape.element_strains)
        put(shape, _truncated=known)
    return known


def _truncation(mesh: Discretization, strains: Floats) -> float:
    system = mesh.static
    freeze(strains)  # as those of a Shape are
    result: float = truncation(system.lengths, strains, system.natural, system.scale, system.basis)
    return result


def _times(shape: Shape, rod: Rod) -> float | None:
    """Return how many times `truncation` the error of a Shape of a Rod surely is below, or None."""
    if rod.yields and shape.dissipated:
        return None if rod.section_model == 'ideal' else _YIELDED
    if shape.contacts:
        return _TOUCHING
    return _FREE if shape.far_end is None else _HELD
