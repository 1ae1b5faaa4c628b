"""What one look at a DLO tells: distances of seen points from a predicted shape, robustly weighed.

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

_ABOUT = 0.1          # of the length: about the DLO, where outliers are
_MEDIAN = {2: 1.3862943611198906, 3: 2.3659738843753377}  # of a chi-square, by degrees of freedom
_BADLY = 4.0          # times the noise's square: more than that, and the shape does not fit yet


@dataclass(frozen=True, eq=False)
class Look:
    """m points against a shape.

    Attributes:
        away: (m, d) m, from the DLO to the points; across it (d = 2) where their arc lengths are
            not known, along all axes (d = 3) where they are
        slopes: (m, d, n) derivatives of where they are expected, by the state
        sway: (m, d, 3) the same by the sway of the free end
        square: (m,) squared distances by which outliers are judged
    """

    away: np.ndarray
    slopes: np.ndarray
    sway: np.ndarray
    square: np.ndarray

    def information(self, noise, outliers, sway, length):
        """Return what the look tells of the state, to first order, as a Told.

        Args:
            noise: m; outliers: part of the points that are none of the DLO's
            sway: standard deviation of the free end's sway, m; length: of the DLO, m
        """
        square = self.square
        for _ in range(2 if sway else 1):
            scale = _scale(square, self.away.shape[1], noise)
            weights = _weights(square, self.away.shape[1], scale, outliers, length)
            root = (np.sqrt(weights) / scale)[:, None]
            rows = (self.slopes * root[:, :, None]).reshape(-1, self.slopes.shape[2])
            right = (self.away * root).ravel()
            if not sway:
                break
            swaying = (self.sway * root[:, :, None]).reshape(-1, 3)
            inner = np.linalg.inv(swaying.T @ swaying + np.eye(3) / sway**2)
            most_likely = inner @ (swaying.T @ right)
            square = np.sum((self.away - self.sway @ most_likely) ** 2, axis=1)
        matrix, vector = rows.T @ rows, rows.T @ right
        if sway:  # it is another one in each look: what is left without it (Schur)
            across = rows.T @ swaying
            matrix = matrix - across @ inner @ across.T
            vector = vector - across @ most_likely
        own = max(float(weights.sum()), 1e-300)
        return Told(matrix, vector, float(np.sqrt(weights @ square / own)),
                    float(1 - weights.mean()), scale)


@dataclass(frozen=True, eq=False)
class Told:
    """What a look tells: (x - here)^T matrix (x - here) / 2 - vector^T (x - here), m points.

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


def looked_at(varied, shape, slopes, points, s, bias):
    """Return the Look at points (m, 3).

    Args:
        varied: Varied; shape: Shape; slopes: (N + 1, 3, n) of its nodes by the state
        points: m, as they are seen; bias: (3,) m, the camera's
        s: (m,) arc lengths, or None
    """
    known, length, uncertain = s is not None, shape.s[-1], varied.uncertain
    # copies: kernels are compiled for arrays that may be written
    nodes, kernels, points = np.array(shape.s), shape.for_kernels, points - bias
    if known:
        s = np.clip(s, 0.0, length)
    else:
        lengths, strains, frames, positions = kernels
        s, _ = nearest(nodes, lengths, strains, frames, positions, points)
    axes, places = _points_at(nodes, *kernels, s)
    by_state = at_arc_lengths(slopes, shape.s, s)
    columns, numbers = uncertain.columns('camera')
    by_state[:, numbers, columns] += 1.0
    off = points - places
    if known:  # nodes move along with the length, but for the end what is marked does not
        inside = s < length
        for column in uncertain.columns('length')[0]:
            by_state[inside, :, column] -= axes[inside, :, 0] * (s[inside] / length)[:, None]
        axes = np.tile(np.eye(3), (len(s), 1, 1))
    else:
        axes = axes[:, :, 1:]
    return Look(np.einsum('mij,mi->mj', axes, off), axes.transpose(0, 2, 1) @ by_state,
                axes.transpose(0, 2, 1) * ((s / length) ** 2)[:, None, None],
                np.sum(off**2, axis=1))


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


def from_either_end(shape, points, s):
    """Return the arc lengths (m,), or those from the other end if the points fit these better."""
    both = s, shape.s[-1] - s
    off = [np.median(np.linalg.norm(points - shape.positions_at(np.clip(
        one, 0.0, shape.s[-1])), axis=1)) for one in both]
    return both[int(off[1] < off[0])]
