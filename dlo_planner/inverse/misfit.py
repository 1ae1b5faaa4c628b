"""How far observed points are from a DLO, with derivatives by the rod and the gripper's poses.

Each observation costs one equilibrium; the derivatives come from its sensitivities.
"""

from dataclasses import dataclass, replace

import numpy as np

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.search import left_jacobian
from dlo_planner.kernels import kernel
from dlo_planner.model.pose import displaced
from dlo_planner.ritz.kinematics import point_inside

_BENT = 0.1  # rad along the length: how far natural curvature is moved as one unit
_STEP = 1e-6  # of a unit: for differences of predicted shapes
_ITERATIONS = 20


@dataclass(frozen=True, eq=False)
class Misfit:
    """Distances of m points from a DLO, n unknowns.

    Attributes:
        away: (m, 3) m, in axes of the DLO where an arc length is sought, in the world's else
        counts: (m, 3) which of them are observed: a nearest point slides along the DLO, but not
            over its end
        slopes: (m, 3, n) their derivatives by the unknowns
        shapes: the Shapes; converged: whether all are equilibria
    """

    away: np.ndarray
    counts: np.ndarray
    slopes: np.ndarray
    shapes: tuple
    converged: bool


class Observed:
    """Observations as a function of unknowns x (n,): parameters first, then errors of the poses.

    Parameters are logarithms of stiffness and units of natural curvature, both against `rod`;
    errors of each pose are in standard deviations.

    Args:
        rod: Rod; observations: Observations; parameters: names
        pose: (k, 6) unit vectors times standard deviations, rad before m, of the errors to be found
        options: of the `DirectSimulator`
        progress: Progress
    """

    def __init__(self, rod, observations, parameters, pose, options, progress):
        self.rod, self.observations, self.parameters = rod, observations, parameters
        self._pose, self._options, self._progress = pose, options, progress
        self.n_parameters = sum(1 + (name == 'natural_curvature') for name in parameters)
        self.size = self.n_parameters + len(pose) * len(observations)
        self._known = {}

    def gripper(self, index, x):
        """Return the Pose of an observation with its error, and the error's twist (6,)."""
        k = len(self._pose)
        begin = self.n_parameters + k * index
        twist = x[begin:begin + k] @ self._pose
        return displaced(self.observations[index].gripper, twist), twist

    def at(self, x):
        """Return the Misfit at unknowns x (n,)."""
        key = x.tobytes()
        if key not in self._known:
            self._known = {**dict(list(self._known.items())[-3:]), key: self._at(x)}
        return self._known[key]

    def _at(self, x):
        values = x[:self.n_parameters]
        direct = DirectSimulator(changed(self.rod, self.parameters, values), **self._options)
        nearby = _Nearby([changed(self.rod, self.parameters, values + step)
                          for step in _STEP * np.eye(self.n_parameters)])
        parts = []
        for index, one in enumerate(self.observations):
            gripper, twist = self.gripper(index, x)
            # set down in its natural shape each time: from another shape it may come to a third
            shape = direct.solve(gripper)
            self._progress.check()
            parts.append(self._part(index, one, shape, nearby, twist) if shape.converged
                         else self._nowhere(one, shape))
        return Misfit(*(np.concatenate(part) for part in list(zip(*parts, strict=True))[:3]),
                      tuple(part[3] for part in parts), all(part[3].converged for part in parts))

    def _nowhere(self, one, shape):
        """Return what stands for an observation without an equilibrium."""
        m = len(one.points)
        return (np.full((m, 3), self.rod.length), np.ones((m, 3), dtype=bool),
                np.zeros((m, 3, self.size)), shape)

    def _part(self, index, one, shape, nearby, twist):
        """Return away, counts, slopes and the Shape of one observation."""
        m = len(one.points)
        s, counts = one.s, np.ones((m, 3), dtype=bool)
        if s is None:
            # copies: the kernel is compiled for arrays that may be written
            s, outward = nearest(*map(np.array, (shape.s, np.diff(shape.s), shape.element_strains,
                                                 shape.frames, shape.positions, one.points)))
            counts[:, 0] = outward
        axes, positions = (np.array(part) for part in zip(*map(shape.frame_at, s), strict=True))
        if one.s is not None:
            axes = np.tile(np.eye(3), (m, 1, 1))
        away = np.einsum('mji,mj->mi', axes, one.points - positions)
        slopes = np.zeros((m, 3, self.size))
        sensitivity = Sensitivity(shape)
        for k, other in enumerate(nearby.on(shape)):
            moved = sensitivity.predicted_on(other)
            slopes[:, :, k] = (positions - [moved.frame_at(value)[1] for value in s]) / _STEP
        if len(self._pose):
            begin = self.n_parameters + len(self._pose) * index
            by_twist = np.array([sensitivity.at(value)[3:] for value in s])
            by_twist[:, :, :3] = by_twist[:, :, :3] @ left_jacobian(twist[:3])
            slopes[:, :, begin:begin + len(self._pose)] = -by_twist @ self._pose.T
        slopes = np.einsum('mji,mjk->mik', axes, slopes)
        return away * counts, counts, slopes * counts[:, :, None], shape


class _Nearby:
    """Rods that differ a little, each on a mesh once for all shapes on that mesh."""

    def __init__(self, rods):
        self._rods, self._base, self._on_base = rods, None, ()

    def on(self, shape):
        """Return the Discretisations of the rods with the elements of a Shape."""
        if shape._discretisation is not self._base:
            self._base = shape._discretisation
            self._on_base = tuple(self._base.of(rod) for rod in self._rods)
        return self._on_base


def changed(rod, parameters, x):
    """Return the rod with logarithms of stiffness and units of curvature changed by x."""
    values, x = {}, list(x)
    for name in parameters:
        if name == 'natural_curvature':
            values[name] = tuple(np.array(rod.natural_curvature)
                                 + curvature_unit(rod) * np.array([x.pop(0), x.pop(0)]))
        elif name == 'bending_stiffness':
            values[name] = tuple(np.array(rod.bending_stiffness) * np.exp(x.pop(0)))
        else:
            values[name] = rod.torsional_stiffness * np.exp(x.pop(0))
    return replace(rod, section=_section(rod, values), **values)


def _section(rod, values):
    """Return the section whose material gives the changed stiffness; None without a section."""
    if rod.section is None:
        return None
    moduli = {}
    if 'bending_stiffness' in values:
        moduli['youngs_modulus'] = (rod.section.youngs_modulus
                                    * values['bending_stiffness'][0] / rod.bending_stiffness[0])
    if 'torsional_stiffness' in values:
        moduli['shear_modulus'] = (rod.section.shear_modulus
                                   * values['torsional_stiffness'] / rod.torsional_stiffness)
    return replace(rod.section, **moduli)


def curvature_unit(rod):
    """Return the natural curvature that counts as one unit, 1/m."""
    return _BENT / rod.length


@kernel
def nearest(s, lengths, strains, rotations, positions, points):
    """Return arc lengths (m,) of the DLO's nearest points, and whether each is beyond an end.

    Chords tell the element, Newton's method finds the point on its arc and those beside it.

    Args:
        s: (N + 1,) m; lengths: (N,); strains: (N, 3); rotations: (N + 1, 3, 3);
            positions: (N + 1, 3); points: (m, 3)
    """
    n = lengths.size
    out, outward = np.empty(points.shape[0]), np.zeros(points.shape[0], dtype=np.bool_)
    frame, x = np.empty((3, 3)), np.empty(3)
    for j in range(points.shape[0]):
        best = np.inf
        place = 0.0
        for e in range(n):
            along = square = 0.0
            for i in range(3):
                chord = positions[e + 1, i] - positions[e, i]
                along += (points[j, i] - positions[e, i]) * chord
                square += chord * chord
            share = min(max(along / square, 0.0), 1.0)
            distance = 0.0
            for i in range(3):
                distance += (points[j, i] - (1 - share) * positions[e, i]
                             - share * positions[e + 1, i]) ** 2
            if distance < best:
                best, place = distance, s[e] + share * lengths[e]
        for _ in range(_ITERATIONS):
            e = min(max(np.searchsorted(s, place, side='right') - 1, 0), n - 1)
            point_inside(lengths, strains, rotations, positions, e, (place - s[e]) / lengths[e],
                         frame, x)
            slope, bend = 0.0, 1.0
            for i in range(3):
                off = points[j, i] - x[i]
                slope += off * frame[i, 0]
                bend -= off * (strains[e, 2] * frame[i, 1] - strains[e, 1] * frame[i, 2])
            step = slope / max(bend, 0.5)
            outward[j] = (place == 0.0 and slope < 0.0) or (place == s[n] and slope > 0.0)
            target = min(max(place + step, 0.0), s[n])
            still = abs(target - place) <= 1e-13 * s[n]
            if still:
                break
            place = target
        out[j] = place
    return out, outward
