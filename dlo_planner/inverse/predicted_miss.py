"""By how much an estimated DLO will miss the centres that a plan leads it through, and how sure."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.response import node_slopes
from dlo_planner.inverse.settling import settled
from dlo_planner.model.checks import number, results, row, shown
from dlo_planner.model.value import Value, brief, put

_CROSSINGS = 20   # steps of Newton's method to a plane
_STILL = 1e-12    # of the length
_MOST = 1_000_000  # waypoints
_SHARE = 0.95     # of what may be, by which a miss is bounded
_RINGS, _SPOKES = 24, 32  # points that stand for a normal distribution in a plane


@dataclass(frozen=True, eq=False, repr=False)
class PredictedMiss(Value):
    """Misses at k waypoints of a plan, in the planes of the centres that should be passed.

    Attributes:
        waypoints: (k,) their indices in the plan
        off: (k, 3) from the centre to where the estimated DLO passes its plane, m, world axes; a
            DLO too short to get there is extended straight on
        covariance: (k, 3, 3) of that, m^2
        bound: (k,) distances that are kept with 95 %, m; infinite where no shape was found
    """

    waypoints: np.ndarray
    off: np.ndarray
    covariance: np.ndarray
    bound: np.ndarray

    def __post_init__(self):
        waypoints = row('PredictedMiss.waypoints', self.waypoints, least=0, minimum=0,
                        maximum=_MOST)
        parts = {name: results(f'PredictedMiss.{name}', getattr(self, name), (None, *shape))
                 for name, shape in (('off', (3,)), ('covariance', (3, 3)), ('bound', ()))}
        for name, part in parts.items():
            if len(part) != waypoints.size:
                raise InvalidTask(f'PredictedMiss.{name} has {len(part)} entries, '
                                  f'PredictedMiss.waypoints {waypoints.size}: expected as many')
        put(self, waypoints=waypoints.astype(int), **parts)
        super().__post_init__()

    def __repr__(self):
        worst = self.bound.max(initial=0.0)
        return brief(self, f'{self.waypoints.size} waypoints',
                     f'most likely up to {self.distance.max(initial=0.0):.2g} m',
                     f'with 95 % up to {worst:.2g} m')

    @property
    def distance(self) -> np.ndarray:
        """(k,) most likely distances from the centres, m."""
        return np.linalg.norm(self.off, axis=1)

    def inside(self, room: float) -> bool:
        """Return whether all stay within `room` (m) of the centres with 95 % each."""
        room = number('room', room, minimum=0)
        return bool((self.bound <= room).all())


def miss_of(estimate, plan, waypoints, shapes=None):
    """Return the PredictedMiss of an Estimate at some waypoints of a Plan.

    Args:
        waypoints: indices of waypoints that pass a centre, as a row of numbers
        shapes: of the estimated DLO there, if they are known
    """
    off = np.full((len(waypoints), 3), np.inf)
    covariance, bound = np.full((len(waypoints), 3, 3), np.inf), np.full(len(waypoints), np.inf)
    for k, index in enumerate(waypoints):
        shape = predicted_shape(estimate, plan, index) if shapes is None else shapes[k]
        if not shape.converged:
            continue
        varied = estimate.uncertain.varied(plan.shapes[index]._discretisation)
        off[k], covariance[k], bound[k] = _miss_at(estimate, varied, shape,
                                                   *_pass(estimate, plan, index))
    return PredictedMiss(np.array(waypoints, dtype=float), off, covariance, bound)


def predicted_shape(estimate, plan, index):
    """Return the Shape of the estimated DLO at a waypoint, the gripper off as it is estimated."""
    planned = plan.shapes[index]
    varied = estimate.uncertain.varied(planned._discretisation)
    return settled(varied, estimate.mean, estimate.actual(plan.grippers[index]), planned, False)


def passing(plan):
    """Return the indices of the waypoints that pass a centre."""
    return [k for k, passes in enumerate(plan.passes) if passes]


def judged_waypoints(plan, waypoints):
    """Return indices of waypoints that pass a centre; None stands for all of them."""
    known = passing(plan)
    if waypoints is None:
        return known
    chosen = row('waypoints', waypoints, minimum=0, maximum=_MOST).tolist()
    if len(chosen) > len(plan) or not {*chosen} <= {*known}:
        raise InvalidTask(f'waypoints = {shown(chosen)}: expected indices of waypoints that pass a '
                          f'centre, out of {shown(known)}')
    return [int(k) for k in chosen]


def _pass(estimate, plan, index):
    """Return centre (3,), normal (3,) or None and arc length of the last pass of a waypoint."""
    centre, s, normal = plan.passes[index][-1]
    return estimate.centre(centre), normal, s


def _miss_at(estimate, varied, shape, centre, normal, s):
    """Return the miss (3,), its covariance (3, 3) and its bound, m."""
    off, normal, tangent, s = crossing(shape, centre, normal, s)
    slopes = at_arc_lengths(node_slopes(varied, estimate.mean, shape), shape.s, np.array([s]))[0]
    columns, number = estimate.uncertain.columns('cutout')
    slopes[number, columns] -= 1.0
    slopes -= np.outer(tangent, normal @ slopes) / (normal @ tangent)  # in the plane
    covariance = slopes @ estimate.covariance @ slopes.T
    across = np.linalg.svd(normal[None])[2][1:]
    return off, covariance, _bound(across @ off, across @ covariance @ across.T)


def crossing(shape, centre, normal, s):
    """Return where a Shape, extended straight on at its end, crosses a plane near `s` (m).

    Args:
        centre: (3,) in the plane; normal: (3,), or None: across the DLO

    Returns:
        from the centre to the DLO (3,), normal, tangent there (3,), arc length (at most the length)
    """
    for _ in range(_CROSSINGS):
        inside = min(max(s, 0.0), shape.s[-1])
        axes, position = shape.frame_at(float(inside))
        tangent = axes[:, 0]
        across = tangent if normal is None else normal
        position = position + (s - inside) * tangent
        step = across @ (centre - position) / (across @ tangent)
        s += step
        if abs(step) < _STILL * shape.s[-1]:
            break
    return position - centre, np.array(across), tangent, inside


def at_arc_lengths(nodes, s, wanted):
    """Return (m, 3, n) at `wanted` (m,): slopes (N + 1, 3, n) at nodes `s`, straight between."""
    element = np.clip(np.searchsorted(s, wanted, side='right') - 1, 0, s.size - 2)
    share = ((wanted - s[element]) / (s[element + 1] - s[element]))[:, None, None]
    return (1 - share) * nodes[element] + share * nodes[element + 1]


def _bound(off, covariance):
    """Return the distance from the centre that a normal distribution in a plane keeps with 95 %."""
    values, vectors = np.linalg.eigh(covariance)
    points = off + _PLANE * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    return float(np.quantile(np.linalg.norm(points, axis=1), _SHARE))


def _plane():
    """Return points (k, 2), equally likely, of a standard normal distribution in a plane."""
    parts = (np.arange(_RINGS) + 0.5) / _RINGS
    radii = np.sqrt(-2 * np.log(1 - parts))
    angles = 2 * np.pi * (np.arange(_SPOKES) + 0.5) / _SPOKES
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return (radii[:, None, None] * directions).reshape(-1, 2)


_PLANE = _plane()
