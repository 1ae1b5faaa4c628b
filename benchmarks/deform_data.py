# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of the DEFORM data set (see `deform.recordings`), and what holds the cable in them."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from dlo_planner import FarEnd, Pose

Array = NDArray[np.float64]
DT = 0.01                 # s between two frames
_WEIGHTS = np.logspace(-3, 12, 151)  # of what is smoothed, of which the data choose one
_LEAD = 50                # frames before the first one, in which the grippers begin to move
_REACH = 0.999            # of the length: the largest distance of the ends that is simulated
_FLOOR = 2e-3 + 1e-6      # m: their evaluation lifts markers that are below it
_N_AXIS = np.array([0.0, 0.6, 0.8])  # the axis n at time 0, as in their code, across the tangent
_HARDLY = 0.05            # share of a component that smoothing keeps, and less is nothing
_EVERY = 25               # frames between two that the lengths are taken from


@dataclass(frozen=True)
class Recording:
    """A recording: name, and markers (frames, markers, 3) in m."""

    name: str
    markers: Array

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a coordinate of a marker, m: what smoothing takes away."""
        every = [smoothed(one).noise for one in self.markers.swapaxes(0, 1)]
        return float(np.sqrt(np.mean(np.square(every))))

    @cached_property
    def _places(self) -> tuple[Array, Array]:
        """(frames, 3) each: where the cable leaves either gripper, less the noise."""
        return smoothed(self.markers[:, 1]).values, smoothed(self.markers[:, -2]).values

    @cached_property
    def _turned(self) -> tuple[list[Rotation], list[Rotation]]:
        """Frames (t, n, b) of both grippers at each frame, carried along without a roll.

        The two markers of a gripper are near each other: what is smoothed is their difference,
        which moves less than they do, and bears more smoothing.
        """
        near, far = self.directions
        return carried(near.values), carried(far.values)

    @cached_property
    def directions(self) -> tuple['Smooth', 'Smooth']:
        """From the first marker of either gripper to its second, less the noise."""
        return (smoothed(self.markers[:, 1] - self.markers[:, 0]),
                smoothed(self.markers[:, -1] - self.markers[:, -2]))

    def held(self, length: float, frames: range | None = None, lead: bool = True
             ) -> tuple[list[Pose], list[FarEnd]]:
        """Return what holds a cable of a length in m at both ends, from the clamped markers alone.

        The far end may turn about its tangent: markers do not show how it is turned. What is
        farther from the gripper than the cable is long is brought nearer.

        Args:
            frames: indices, evenly spaced; None: all
            lead: whether a motion from rest up to the first frame comes before: 0.5 s
        """
        frames = range(len(self.markers)) if frames is None else frames
        before = _LEAD // frames.step if lead else 0
        near = _led(self._places[0][frames], [self._turned[0][k] for k in frames], before)
        far = _led(self._places[1][frames], [self._turned[1][k] for k in frames], before)
        grippers = [Pose.from_rotation(place, turned.as_matrix())
                    for place, turned in zip(*near, strict=True)]
        ends = []
        for pose, place, turned in zip(grippers, *far, strict=True):
            away = place - pose.position
            part = min(1.0, _REACH * length / np.linalg.norm(away))
            ends.append(FarEnd(Pose.from_rotation(pose.position + part * away,
                                                  turned.as_matrix()), 'aligned'))
        return grippers, ends

    def free(self, frames: range) -> Array:
        """Return the markers between the grippers (frames, markers - 4, 3), m."""
        return self.markers[frames, 2:-2]

    def lifted(self, frames: range) -> Array:
        """Return all markers of frames as their evaluation takes them, none below the floor."""
        out = self.markers[frames].copy()
        out[..., 2] = np.maximum(out[..., 2], _FLOOR)
        return out

    def arcs(self) -> Array:
        """Return (k, markers - 3) arc lengths between neighboring markers in frames, m.

        Along a cubic spline through the markers, which leaves the grippers straight. Their noise
        would make it longer: they are smoothed over time first.
        """
        smooth = np.stack([smoothed(one).values for one in self.markers.swapaxes(0, 1)], axis=1)
        return np.array([_spline_lengths(frame) for frame in smooth[::_EVERY]])


def arc_lengths(found: list[Recording]) -> Array:
    """Return the arc length (markers - 2,) of each marker from the gripper, 0 to the free length.

    The second marker is at 0, the last but one at the end. Medians over all recordings.
    """
    steps = np.median(np.concatenate([one.arcs() for one in found]), axis=0)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _spline_lengths(frame: Array) -> Array:
    inner = frame[1:-1]
    places = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(inner, axis=0), axis=1))])
    first, last = frame[1] - frame[0], frame[-1] - frame[-2]
    spline = CubicSpline(places, inner, bc_type=((1, first / np.linalg.norm(first)),
                                                 (1, last / np.linalg.norm(last))))
    nodes, weights = np.polynomial.legendre.leggauss(8)
    middles, halves = 0.5 * (places[1:] + places[:-1]), 0.5 * np.diff(places)
    speeds = np.linalg.norm(spline(middles[:, None] + halves[:, None] * nodes, 1), axis=2)
    return np.asarray(halves * (speeds @ weights))


@dataclass(frozen=True)
class Smooth:
    """Values less their noise.

    Attributes:
        values: (frames, 3)
        noise: standard deviation of what was taken away
        doubts: (k, frames) by what each component of `values` may still be off: k independent
            amounts, each with this standard deviation (posterior of the smoothing)
    """

    values: Array
    noise: float
    doubts: Array


def smoothed(values: Array) -> Smooth:
    """Return values (frames, 3) without their noise, as much of it as they show themselves.

    Those that minimize |smooth - values|^2 + weight |third differences of smooth|^2, the weight by
    generalized cross-validation (Craven and Wahba 1979; Eilers 2003): a filter of a fixed band lets
    noise through at the frequencies of the cable, and shakes it.
    """
    roughness, modes = _modes(len(values))
    parts = modes.T @ values
    kept = 1 / (1 + _WEIGHTS[:, None] * roughness)
    left = ((1 - kept) ** 2) @ np.sum(parts**2, axis=1)
    gone = np.maximum(np.sum(1 - kept, axis=1), 1e-100)
    best = np.argmin(left / gone**2)
    noise = float(np.sqrt(left[best] / (gone[best] * values.shape[1])))
    some = kept[best] > _HARDLY
    return Smooth(modes @ (kept[best, :, None] * parts), noise,
                  noise * np.sqrt(kept[best, some, None]) * modes.T[some])


@lru_cache(maxsize=8)
def _modes(count: int) -> tuple[Array, Array]:
    """Return squares (n,) of the third differences of vectors (n, n), columns, all orthogonal."""
    third = np.diff(np.eye(count), 3, axis=0)
    squares, modes = np.linalg.eigh(third.T @ third)
    squares[:3] = 0.0
    return np.maximum(squares, 0.0), modes


def carried(along: Array) -> list[Rotation]:
    """Return Rotations with columns t, n, b for directions (k, 3), each turned the least way."""
    tangents = along / np.linalg.norm(along, axis=1)[:, None]
    across = _N_AXIS - (tangents[0] @ _N_AXIS) * tangents[0]
    across /= np.linalg.norm(across)
    out = [Rotation.from_matrix(np.column_stack([tangents[0], across,
                                                 np.cross(tangents[0], across)]))]
    for before, now in zip(tangents[:-1], tangents[1:], strict=True):
        axis = np.cross(before, now)
        size = np.linalg.norm(axis)
        angle = np.arctan2(size, before @ now)
        turn = Rotation.from_rotvec(axis * (angle / size if size > 0 else 0.0))
        out.append(turn * out[-1])
    return out


def _led(places: Array, turned: list[Rotation], count: int) -> tuple[Array, list[Rotation]]:
    """Put `count` instants before, in which place and rotation come smoothly from rest.

    The velocity grows as a smooth step to that between the first two instants.
    """
    if not count:
        return places, turned
    x = np.arange(-count, 0) / count + 1
    still_to_go = count * (0.5 - (x**3 - 0.5 * x**4))  # integral of 3 x^2 - 2 x^3 from x to 1
    velocity = places[1] - places[0]
    turn = (turned[1] * turned[0].inv()).as_rotvec()
    led = [Rotation.from_rotvec(-part * turn) * turned[0] for part in still_to_go]
    return np.concatenate([places[0] - still_to_go[:, None] * velocity, places]), led + turned
