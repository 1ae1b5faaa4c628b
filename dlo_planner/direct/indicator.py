"""A quick look at how far a shape can be off: which need no further solution to be sure of.

The error estimate (`Shape.error_estimate`) was never more than 3.1 times `ritz.truncation` over 600
random DLOs that hang freely, 0.8 times where both ends are held (80), 1.8 times where something is
touched (80). Of DLOs that may yield it was 0.5 times (97) as long as they have not, and 4.1 times
(33) where fibres of their section had; of ideal plasticity, point loads and what varies along the
length it says nothing.
"""

from dlo_planner.ritz.truncation import truncation

_FREE, _HELD, _TOUCHING, _YIELDED = 4.0, 1.5, 2.5, 8.0  # times `truncation`: the estimate is below
_STABLE = 0.1    # a shape that is less stable magnifies errors


def surely_within(shape, accuracy, mesh=None):
    """Whether a Shape is certain to be within `accuracy` (m), without a further solution.

    Args:
        mesh: Discretisation on which the shape would be; None: its own
    """
    here = shape._discretisation if mesh is None else mesh
    around, system = here.surroundings, here.static
    times = _times(shape, around.rod)
    if (times is None or shape.stability < _STABLE and shape.far_end is None
            or around.rod.varies or around.point_loads or callable(around.load)):
        return False
    strains = shape.for_kernels[1] if mesh is None else here.strains_from(
        shape.s, shape.element_strains)
    off = truncation(system.lengths, strains, system.natural, system.scale, system.basis)
    return bool(times * off <= accuracy)


def _times(shape, rod):
    """Return how many times `truncation` the error of a Shape of a Rod surely is below, or None."""
    if rod.yields and shape.dissipated:
        return None if rod.section_model == 'ideal' else _YIELDED
    if shape.contacts:
        return _TOUCHING
    return _FREE if shape.far_end is None else _HELD
