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

    def scale(self, noise):
        """Return the noise (m) to weigh with: as stated, or more while the shape fits badly."""
        left = float(np.median(self.square)) / _MEDIAN[self.away.shape[1]]
        return noise if left <= _BADLY * noise**2 else float(np.sqrt(left))

    def weights(self, scale, outliers, length):
        """Return (m,) how likely each point is one of the DLO.

        Args:
            scale: m, of the noise; outliers: part of the points that are none; length: of the DLO
        """
        if outliers == 0:
            return np.ones(len(self.away))
        d = self.away.shape[1]
        own = (1 - outliers) * np.exp(-0.5 * self.square / scale**2) * (
            2 * np.pi * scale**2) ** (-0.5 * d)
        return own / (own + outliers * (2 * _ABOUT * length) ** -d)


def looked_at(shape, slopes, points, s, sway):
    """Return the Look at points (m, 3).

    Args:
        shape: Shape; slopes: (N + 1, 3, n) of its nodes by the state
        points: m, the camera's bias taken off
        s: (m,) arc lengths, or None
        sway: (3,) of the free end, m: the DLO is off by (s / L)^2 of it
    """
    known = s is not None
    length = shape.s[-1]
    share = np.ones(1)
    if not known:
        # copies: the kernel is compiled for arrays that may be written
        s, _ = nearest(*map(np.array, (shape.s, np.diff(shape.s), shape.element_strains,
                                       shape.frames, shape.positions,
                                       points - _swaying(shape, points, sway))))
    s = np.clip(s, 0.0, length)
    share = (s / length) ** 2
    axes, positions = (np.array(part) for part in zip(*map(shape.frame_at, s.tolist()),
                                                      strict=True))
    off = points - positions - share[:, None] * sway
    axes = np.tile(np.eye(3), (len(s), 1, 1)) if known else axes[:, :, 1:]
    by_state = at_arc_lengths(slopes, shape.s, s)
    return Look(np.einsum('mij,mi->mj', axes, off), np.einsum('mij,mik->mjk', axes, by_state),
                np.swapaxes(axes, 1, 2) * share[:, None, None], np.sum(off**2, axis=1))


def _swaying(shape, points, sway):
    """Return (m, 3) how far the DLO sways about where each point is, roughly."""
    if not np.any(sway):
        return np.zeros_like(points)
    node = np.argmin(((points[:, None] - shape.positions[None]) ** 2).sum(axis=2), axis=1)
    return (shape.s[node] / shape.s[-1])[:, None] ** 2 * sway


def from_either_end(shape, points, s):
    """Return the arc lengths (m,), or those from the other end if the points fit these better."""
    both = s, shape.s[-1] - s
    off = [np.median(np.linalg.norm(points - shape.positions_at(np.clip(
        one, 0.0, shape.s[-1])), axis=1)) for one in both]
    return both[int(off[1] < off[0])]
