"""What looks at a DLO tell: distances of seen points from a predicted shape, robustly weighed.

A point is one of the DLO plus normal noise, or, by a part that is stated, none of the DLO's and
anywhere about it. How likely it is the one or the other weighs it (Dempster, Laird and Rubin 1977).
While the shape still fits badly, the scale of what is left stands for the noise: the median of the
squared distances, which outliers do not move.
"""

from dataclasses import dataclass

import numpy as np

from dlo_planner.inverse.misfit import nearest
from dlo_planner.inverse.predicted_miss import at_arc_lengths
from dlo_planner.kernels import kernel
from dlo_planner.ritz.kinematics import point_inside

_ABOUT = 0.1  # of the length: about the DLO, where outliers are
_MEDIAN = {2: 1.3862943611198906, 3: 2.3659738843753377}  # of a chi-square, by degrees of freedom
_BADLY = 4.0  # times the noise's square: more than that, and the shape does not fit yet


@dataclass(frozen=True, eq=False)
class Distances:
    """m points against a shape.

    Attributes:
        away: (m, d) m, from the DLO to the points; across it (d = 2) where their arc lengths are
            not known, along all axes (d = 3) where they are
        axes: (m, d, 3) these directions; frames: (m, 3, 3) of the DLO there; s: (m,) m
        square: (m,) squared distances by which outliers are judged
    """

    away: np.ndarray
    axes: np.ndarray
    frames: np.ndarray
    s: np.ndarray
    square: np.ndarray

    def cost(self, scale, outliers, sway, length):
        """Return minus the logarithm of the likelihood, but for a constant.

        Args:
            scale: m, of the noise; outliers: part of the points; sway: of the free end, m
            length: of the DLO, m
        """
        d = self.away.shape[1]
        square, more = self.square, 0.0
        if sway:
            square, more = self._without_sway(scale, outliers, sway, length)
        if outliers == 0:
            return 0.5 * float(square.sum()) / scale**2 + more
        # of a point: -log((1 - e) N(r) + e / V), the larger part taken out of the sum
        own = -0.5 * square / scale**2
        none = np.log(outliers / (1 - outliers)) + d * np.log(
            np.sqrt(2 * np.pi) * scale / (2 * _ABOUT * length))
        return -float(np.logaddexp(own, none).sum()) + more

    def swaying(self, length):
        """Return (m, d, 3): how the points expected move along `axes` with the free end's sway."""
        return self.axes * ((self.s / length) ** 2)[:, None, None]

    def _without_sway(self, scale, outliers, sway, length):
        """Return squared distances without the most likely sway, and what that one costs."""
        weights = _weights(self.square, self.away.shape[1], scale, outliers, length)
        rows = self.swaying(length)
        most_likely = _sway(rows, self.away, weights, scale, sway)[0]
        return (np.sum((self.away - rows @ most_likely) ** 2, axis=1),
                0.5 * float(most_likely @ most_likely) / sway**2)


@dataclass(frozen=True, eq=False)
class Look:
    """Distances with slopes.

    Attributes:
        distances: Distances
        slopes: (m, d, n) derivatives of where the points are expected, by the state
        swaying: (m, d, 3) the same by the sway of the free end
    """

    distances: Distances
    slopes: np.ndarray
    swaying: np.ndarray


@dataclass(frozen=True, eq=False)
class Told:
    """What looks tell of a state x near `here`, by (x - here)^T matrix (x - here) / 2 - vector^T x.

    Attributes:
        matrix: (n, n); vector: (n,)
        misfit: root mean square distance of what is taken to be the DLO's, m
        outliers: part of the points that are taken to be none of the DLO's
        scale: m, of the noise with which it was weighed
    """

    matrix: np.ndarray
    vector: np.ndarray
    misfit: float
    outliers: float
    scale: float


def squares(shape, points, s):
    """Return the Distances of points (m, 3), m, the camera's bias taken off, from a Shape.

    Args:
        s: (m,) arc lengths, m, or None
    """
    known, length = s is not None, shape.s[-1]
    nodes, kernels = np.array(shape.s), shape.for_kernels  # copies: kernels may write their arrays
    s = np.clip(s, 0.0, length) if known else nearest(nodes, *kernels, points)[0]
    frames, places = _points_at(nodes, *kernels, s)
    off = points - places
    axes = np.tile(np.eye(3), (len(s), 1, 1)) if known else frames[:, :, 1:].transpose(0, 2, 1)
    # beyond an end, how far beyond is not told: the DLO is seen to its end only by chance
    away = np.einsum('mij,mj->mi', axes, off)
    return Distances(away, axes, frames, s, np.sum(away**2, axis=1))


def looked_at(uncertain, shape, slopes, off, known):
    """Return the Look that Distances and slopes make.

    Args:
        uncertain: Uncertain; shape: Shape; slopes: (N + 1, 3, n) of its nodes by the state
        off: Distances from it; known: whether arc lengths were seen
    """
    length = shape.s[-1]
    by_state = at_arc_lengths(slopes, shape.s, off.s)
    columns, numbers = uncertain.columns('camera')
    by_state[:, numbers, columns] += 1.0
    if known:  # nodes go along with the length; what is marked does not, but for the end
        inside = off.s < length
        for column in uncertain.columns('length')[0]:
            by_state[inside, :, column] -= off.frames[inside, :, 0] * (
                off.s[inside] / length)[:, None]
    return Look(off, off.axes @ by_state, off.swaying(length))


def told(look, noise, outliers, sway, length):
    """Return the Told of a Look, to first order.

    Args:
        noise: m; outliers: part of the points that are none of the DLO's
        sway: standard deviation of the free end's sway, m; length: of the DLO, m
    """
    off = look.distances
    d, square = off.away.shape[1], off.square
    for _ in range(2 if sway else 1):
        scale = _scale(square, d, noise)
        weights = _weights(square, d, scale, outliers, length)
        if sway:
            most_likely, inner = _sway(look.swaying, off.away, weights, scale, sway)
            square = np.sum((off.away - look.swaying @ most_likely) ** 2, axis=1)
    root = (np.sqrt(weights) / scale)[:, None]
    rows = (look.slopes * root[:, :, None]).reshape(-1, look.slopes.shape[2])
    matrix, vector = rows.T @ rows, rows.T @ (off.away * root).ravel()
    if sway:  # another one in each look: what is left without it (Schur)
        across = rows.T @ (look.swaying * root[:, :, None]).reshape(-1, 3)
        matrix = matrix - across @ inner @ across.T
        vector = vector - across @ most_likely
    own = max(float(weights.sum()), 1e-300)
    return Told(matrix, vector, float(np.sqrt(weights @ np.sum(off.away**2, axis=1) / own)),
                float(1 - weights.mean()), scale)


def from_either_end(shape, points, s):
    """Return the arc lengths (m,), or those from the other end if the points fit these better."""
    both = s, shape.s[-1] - s
    off = [np.median(np.linalg.norm(points - shape.positions_at(np.clip(
        one, 0.0, shape.s[-1])), axis=1)) for one in both]
    return both[int(off[1] < off[0])]


def _scale(square, d, noise):
    """Return the noise (m) to weigh with: as stated, or more while the shape fits badly."""
    left = float(np.median(square)) / _MEDIAN[d]
    return noise if left <= _BADLY * noise**2 else float(np.sqrt(left))


def _weights(square, d, scale, outliers, length):
    """Return (m,) how likely each point, at a squared distance `square` (m,), is one of the DLO."""
    if outliers == 0:
        return np.ones(len(square))
    own = (1 - outliers) * np.exp(-0.5 * square / scale**2) / (
        2 * np.pi * scale**2) ** (0.5 * d)
    return own / (own + outliers * (2 * _ABOUT * length) ** -d)


def _sway(swaying, away, weights, scale, sway):
    """Return the most likely sway (3,), m, and its covariance (3, 3)."""
    root = (np.sqrt(weights) / scale)[:, None]
    rows = (swaying * root[:, :, None]).reshape(-1, 3)
    inner = np.linalg.inv(rows.T @ rows + np.eye(3) / sway**2)
    return inner @ (rows.T @ (away * root).ravel()), inner


@kernel
def _points_at(nodes, lengths, strains, rotations, positions, s):
    """Return axes (m, 3, 3) and positions (m, 3) at arc lengths s (m,)."""
    m, n = s.size, lengths.size
    axes, places = np.empty((m, 3, 3)), np.empty((m, 3))
    for j in range(m):
        e = min(max(np.searchsorted(nodes, s[j], side='right') - 1, 0), n - 1)
        point_inside(lengths, strains, rotations, positions, e, (s[j] - nodes[e]) / lengths[e],
                     axes[j], places[j])
    return axes, places
