# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Two cords that press on each other at one point, without friction.

The force is what leaves their surfaces in touch: with each trial of it both cords come to rest, and
the distance of their axes where they cross, along the normal of both, has one root. Stretch, place
and normal of the contact are found by turns with it.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq, least_squares, root

from benchmarks.cosserat.cord import Cord, at_rest, settled
from benchmarks.cosserat.stretch import Stretch
from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats

_FIRST = 0.02    # of the weight: the first trial of the force
_MOST = 1e3      # of it: the largest
_TURNS = 20
_TRIALS = 40
_ROUGH = 1e-5    # parts: how well force, place and normal are found together
_SAME = 1e-6     # of strain, of the length, rad: what turns may still change
_PLACED = 1e-3   # m, rad: how well the contact is placed; the gap feels its square
_SAMPLES = 801


class Contact:
    """Two cords with a trial of their contact.

    Attributes
    ----------
    normal
        (3,) from the first to the second.
    places
        (2,) unstretched arc lengths, m.
    stretches
        Stretches of each cord.
    shapes : list of Shape
        Shapes of each cord.
    """

    def __init__(self, cords: tuple[Cord, Cord]) -> None:
        self.cords = cords
        self.stretches = [Stretch.none(cord.length) for cord in cords]
        self.shapes: list[Shape] = []
        lines = [_line(cord) for cord in cords]
        away = np.linalg.norm(lines[0][:, None] - lines[1][None], axis=2)
        nearest = np.unravel_index(away.argmin(), away.shape)
        self.places = np.array([k / (_SAMPLES - 1) * cord.length
                                for k, cord in zip(nearest, cords, strict=True)])
        tangents = [np.gradient(line, axis=0)[k] for line, k in zip(lines, nearest, strict=True)]
        across = lines[1][nearest[1]] - lines[0][nearest[0]]
        self.normal = _normal(tangents, across)

    def rest(self, force: float) -> float:
        """Let both come to rest pressed by `force` in N; return the gap between them in m."""
        self.shapes = [
            at_rest(self.cords[k], self._rods[k], self.stretches[k],
                    [(self.places[k], sign * force * self.normal)])
            for k, sign in enumerate((-1.0, 1.0))]
        points = self._points(self.crossed())
        return float((points[1] - points[0]) @ self.normal) - sum(c.radius for c in self.cords)

    def stretch(self, force: float) -> float:
        """Take the strains of the shapes; return by how much they differ from those before."""
        signs = -1.0, 1.0
        after = [cord.strains(shape, stretch, [(place, sign * force * self.normal)])
                 for cord, shape, stretch, place, sign in zip(
                     self.cords, self.shapes, self.stretches, self.places, signs, strict=True)]
        change = max(one.change(other)
                     for one, other in zip(after, self.stretches, strict=True))
        self.take(after)
        return change

    def take(self, stretches: list[Stretch]) -> None:
        """Begin anew with these Stretches."""
        self.stretches = stretches
        self._rods = [cord.rod(one) for cord, one in zip(self.cords, stretches, strict=True)]

    def misfit(self, trial: Floats, start: Floats) -> Floats:
        """Return what a trial (5,) misses: the gap, the places, the normal, as parts.

        Parameters
        ----------
        trial : ndarray
            Force over `start[0]`, places in m, two tilts of the normal off `start[1:]`.
        """
        force, normal = trial[0] * start[0], start[1:]
        sides = np.linalg.svd(normal[None])[2][1:]
        self.places = trial[1:3]
        self.normal = normal + trial[3:] @ sides
        self.normal /= np.linalg.norm(self.normal)
        gap = self.rest(force)
        places = self.crossed()
        tangents = [shape.at(float(stretch.to_stretched(s))).direction for shape, stretch, s
                    in zip(self.shapes, self.stretches, places, strict=True)]
        turned = sides @ (_normal(tangents, self.normal) - self.normal)
        return np.concatenate([[gap / self.cords[0].length], places - trial[1:3], turned])

    def crossed(self) -> Floats:
        """Return the unstretched arc lengths (2,) at which both cross, seen along the normal."""
        across = np.eye(3) - np.outer(self.normal, self.normal)
        found = least_squares(lambda places: across @ np.subtract(*self._points(places)),
                              self.places, diff_step=1e-6, xtol=1e-13, ftol=1e-15, gtol=1e-15)
        result: Floats = found.x
        return result

    def _points(self, places: Floats) -> list[Floats]:
        return [shape.frame_at(float(np.clip(stretch.to_stretched(s), 0.0, shape.s[-1])))[1]
                for shape, stretch, s in zip(self.shapes, self.stretches, places, strict=True)]


def pressed(cords: tuple[Cord, Cord]) -> list[tuple[Shape, Stretch]]:
    """Return of each cord the Shape in which it rests and its Stretch.

    Raises
    ------
    FloatingPointError
        No force keeps them apart.
    """
    contact = Contact(cords)
    contact.take(contact.stretches)
    weight = sum(cord.density * cord.area * cord.length * float(np.linalg.norm(cord.gravity))
                 for cord in cords)
    force = _force(contact, _FIRST * weight, _MOST * weight)
    if not force:
        return [settled(cord) for cord in cords]
    for _ in range(_TURNS):
        start = np.concatenate([[force], contact.normal])
        found = root(contact.misfit, [1.0, *contact.places, 0.0, 0.0], args=(start,),
                     options={'eps': 1e-4, 'xtol': _ROUGH, 'maxfev': _TRIALS})
        if np.abs(found.fun).max() > _PLACED:  # the mesh moves with the place: not quite smooth
            raise FloatingPointError(f'the contact was not found, {found.fun} is left')
        contact.misfit(found.x, start)
        force = _refined(contact, found.x[0] * force)
        before = list(zip(contact.shapes, contact.stretches, strict=True))
        if contact.stretch(force) < _SAME:
            return before
    raise FloatingPointError('the stretch was not found')


def _force(contact: Contact, step: float, most: float) -> float:
    """Return the force in N that leaves both in touch, 0 where they are apart without."""
    low, gap = 0.0, contact.rest(0.0)
    if gap >= 0:
        return 0.0
    high = step
    while contact.rest(high) < 0:
        low, high = high, 2 * high
        if high > most:
            raise FloatingPointError('the cords cannot be pressed apart')
    return float(brentq(contact.rest, low, high, xtol=1e-3 * step))


def _refined(contact: Contact, force: float) -> float:
    """Return the force with which the gap vanishes, from a good guess, at the same place."""
    far = (1 + 100 * _ROUGH) * force
    one, other = contact.rest(force), contact.rest(far)
    force -= one * (far - force) / (other - one)
    contact.rest(force)
    return force


def _line(cord: Cord) -> Floats:
    even = np.linspace(0, cord.n, _SAMPLES)
    return np.column_stack([np.interp(even, np.arange(cord.n + 1), row) for row in cord.nodes.T])


def _normal(tangents: Sequence[Floats], side: Floats) -> Floats:
    """Return the unit normal (3,) of two tangents, to the side of (3,) another vector."""
    normal = np.cross(tangents[0], tangents[1])
    result: Floats = normal * (np.sign(normal @ side) / np.linalg.norm(normal))
    return result
