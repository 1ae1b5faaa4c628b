# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that is nearly taut between its grips: a mesh that shows how it bends, and a first shape.

Where the grips are almost a length apart, the DLO is a string under tension, whose sag takes up
what is left of the length, and bends only next to clamps, over l = sqrt(EI / tension): there
tan(angle / 4) decays like exp(-s / l) (the elastica of infinite length, Love 1927, art. 262), and
takes 2 l (1 - cos(angle / 2)) of the length. From the first shape Newton's method needs a few
steps; from the straight DLO it would have to find the tension, which grows beyond all bounds.
"""

from __future__ import annotations

from dataclasses import replace
from math import acos, cos, exp, log, sqrt
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, root
from scipy.spatial.transform import Rotation

from dlo_planner.direct.discretization import Discretization, Memory, with_breaks
from dlo_planner.geometry.so3 import turn_between
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import Hold, Holds, named, places_of
from dlo_planner.model.pose import Pose

_TAUT = 10.0    # l in the length: with so many tension decides
_SURELY, _SLACK = 1e-9, 0.05  # of the length: slack that is looked at
_TRIALS = 60    # forces with which the string is added up
_FAR = 20.0     # of the logarithm of the tension, from what is expected
_CLOSE = 1e-3   # of the slack: how well the first shape ends where the far end is held
_ELEMENT, _GROWTH = 0.4, 0.2  # elements next to clamps: of l; longer by so much of their distance
_ROUGH = 0.8    # of l: elements that are longer are too long
_APART = 0.3    # of an element: the least distance of two nodes
_OPPOSITE = 1e-6  # of two unit vectors' sum: below, they say nothing of what is between
_POINT, _POINTS = 0.15, 40  # of l, in the length: where the string is added up


class Stretch(NamedTuple):
    """A part of the DLO between two neighboring grips; n elements."""

    first: int       # node at its beginning,
    last: int        # and at its end
    lengths: Floats  # (n,) m, of its elements
    s: Floats        # (n + 1,) m, of its nodes from its beginning on
    begin: Floats    # (3,) m, where they are held
    end: Floats
    tangents: tuple[Floats | None, Floats | None]  # (3,) there; None: free to turn
    slides: bool     # whether an end may slide
    names: tuple[str, str]  # of both grips


def stretches(mesh: Discretization, gripper: Pose, holds: Holds) -> list[Stretch]:
    """Return the parts of a DLO between its grips."""
    found: list[Stretch] = []
    first, begin, slid, before = 0, gripper.position, False, 'gripper'
    known = None if mesh.surroundings.pinned else gripper.rotation[:, 0]
    nodes = mesh.held_nodes(holds)[0].tolist()
    for k, hold in enumerate(holds):
        last, end, slides = nodes[k], hold.pose.position, hold.grip == 'sleeve'
        tangent = hold.pose.rotation[:, 0] if hold.grip != 'pinned' else None
        if hold.grip == 'pinned' and hold.s is not None:
            tangent = pin_tangent(gripper, holds, k)
        name = 'far end' if hold.s is None else named(hold)
        found.append(Stretch(first, last, mesh.free.lengths[first:last],
                             mesh.s[first:last + 1] - mesh.s[first], begin, end, (known, tangent),
                             slid or slides, (before, name)))
        first, begin, known, slid, before = last, end, tangent, slides, name
    return found


def pin_tangent(gripper: Pose, holds: Holds, k: int) -> Floats | None:
    """Return the DLO's tangent (3,) at hold k, a pin inside: it halves the angle of its sides.

    None where those say nothing.
    """
    places = [gripper.position, *(hold.pose.position for hold in holds)][k:k + 3]
    both = np.zeros(3)
    for one, other in zip(places, places[1:], strict=False):
        way = other - one
        size = sqrt(way @ way)
        both += way / size if size > 0.0 else 0.0
    size = sqrt(both @ both)
    return both / size if size > _OPPOSITE else None


class Span(NamedTuple):
    """What keeps a nearly taut part of a DLO between two grips."""

    tension: float               # N, about
    bends: tuple[float, float]   # m, l at both grips; infinite: not clamped
    way: Floats                  # (3,) unit vector from one to the other
    slack: float                 # m, length less distance


def span_of(mesh: Discretization, part: Stretch) -> Span | None:
    """Return the Span of a Stretch; None where it is not nearly taut, or out of reach."""
    away, lengths = part.end - part.begin, part.lengths
    length, distance = float(part.s[-1]), sqrt(away @ away)
    slack = length - distance
    if part.slides or not _SURELY * length < slack < _SLACK * length:
        return None
    way = away / distance
    stiff = [float(mesh.free.stiffness[end, 1:].mean()) for end in (part.first, part.last - 1)]
    angles = [0.0 if tangent is None else acos(max(-1.0, min(1.0, float(way @ tangent))))
              for tangent in part.tangents]
    parts = [2 * sqrt(one) * (1 - cos(angle / 2))
             for one, angle in zip(stiff, angles, strict=True)]
    across = _pulls(mesh, part)
    across = across - np.outer(across @ way, way)
    sag = 0.5 * float(lengths @ (across * across).sum(axis=1))
    tension = _tension(sag, sum(parts), slack)
    if not tension * length**2 > _TAUT**2 * max(stiff):
        return None
    bends = [sqrt(one / tension) if angle else np.inf
             for one, angle in zip(stiff, angles, strict=True)]
    return Span(tension, (bends[0], bends[1]), way, slack)


def is_taut(mesh: Discretization, gripper: Pose, holds: Holds) -> bool:
    """Whether any part of a DLO between two grips is nearly taut."""
    return any(span_of(mesh, part) is not None for part in stretches(mesh, gripper, holds))


def _tension(sag: float, bend: float, slack: float) -> float:
    """Return T in N where sag / T^2 + bend / sqrt(T) = slack."""
    if sag == 0.0:
        return (bend / slack)**2
    least = max(sqrt(sag / slack), (bend / slack)**2)  # with four times as much either is half
    result: float = brentq(lambda tension: sag / tension**2 + bend / sqrt(tension) - slack,
                           0.99 * least, 4.04 * least)
    return result


def _pulls(mesh: Discretization, part: Stretch) -> Floats:
    """Return (n, 3) the force in each element, N, less its mean: what dead loads make of it."""
    beyond = -np.cumsum(mesh.free.load.pull[part.last:part.first:-1], axis=0)[::-1]
    pulls: Floats = beyond - part.lengths @ beyond / part.s[-1]
    return pulls


def bent_mesh(mesh: Discretization, gripper: Pose, holds: Holds, basis: str) -> Discretization:
    """Return a Discretization whose elements can bend as they have to next to clamps; or `mesh`."""
    parts = stretches(mesh, gripper, holds)
    nodes = [_bent_nodes(mesh, part) for part in parts]
    if all(one is None for one in nodes):
        return mesh
    s = np.concatenate([
        *(mesh.s[part.first:part.last] if one is None else mesh.s[part.first] + one[:-1]
          for part, one in zip(parts, nodes, strict=True)), mesh.s[parts[-1].last:]])
    breaks = np.union1d(mesh.surroundings.breaks, places_of(holds))
    return Discretization(mesh.surroundings, with_breaks(s, breaks), basis, mesh.n_terms)


def _bent_nodes(mesh: Discretization, part: Stretch) -> Floats | None:
    """Return nodes of a Stretch, from 0 on, that follow its bends; None if they do already."""
    span = span_of(mesh, part)
    if span is None:
        return None
    s = part.s
    length = s[-1]
    begin, end = (_from_clamp(bend, h) for bend, h in
                  zip(span.bends, (s[1], length - s[-2]), strict=True))
    if begin.size + end.size == 2:
        return None
    begin, end = (one[one < 0.5 * length] for one in (begin, end))  # of a short one they may meet
    inner = s[(s > begin[-1] + _APART * s[1] * (begin.size > 1))
              & (s < length - end[-1] - _APART * (length - s[-2]) * (end.size > 1))]
    return np.concatenate([begin, inner[(inner > 0) & (inner < length)], length - end[::-1]])


def coarseness(mesh: Discretization, gripper: Pose, holds: Holds) -> str:
    """Return in words that elements are too long to bend as they have to next to clamps, or ''."""
    coarse = []
    for part in stretches(mesh, gripper, holds):
        span, lengths = span_of(mesh, part), part.lengths
        if span is not None:
            coarse += [(longest, bend, where, span.slack) for where, bend, longest in
                       zip(part.names, span.bends, lengths[[0, -1]], strict=True)
                       if longest > _ROUGH * bend]
    if not coarse:
        return ''
    longest, bend, where, slack = max(coarse, key=lambda one: one[0] / one[1])
    return (f'the mesh is too coarse for a slack of {slack:.3g} m: the DLO bends within '
            f'{bend:.2g} m of the {where}, where an element is {longest:.2g} m long; give an '
            'accuracy instead of n_elements, which grades the mesh, or '
            f'{int(mesh.s[-1] / (_ELEMENT * bend)) + 1} elements')


def _from_clamp(bend: float, longest: float) -> Floats:
    """Return (n,) nodes, from 0 on, that follow a bend until elements are `longest` (m)."""
    nodes = [0.0]
    if longest > _ROUGH * bend:
        while (step := _ELEMENT * bend + _GROWTH * nodes[-1]) < longest:
            nodes.append(nodes[-1] + step)
    return np.array(nodes)


def first_shape(mesh: Discretization, gripper: Pose, far_end: Hold,
                memory: Memory) -> tuple[Pose, Floats, Memory, bool] | None:
    """Return gripper, strains (N, 3) and the past of a DLO near its shape; None if not nearly taut.

    The tip alone is held beside the gripper, which is turned to its beginning if that is pinned.
    The past has the forces of the tip's grip. All torsion is that which the clamps need, as near to
    the natural one as they allow.
    """
    part, = stretches(mesh, gripper, (far_end,))
    span = span_of(mesh, part)
    if span is None:
        return None
    string = _String(mesh, part, span)
    force = string.force()
    if force is None:
        return None
    tangents = string.tangents(force, mesh.s)
    base = gripper.rotation
    if mesh.surroundings.pinned:
        base = _turned(base[:, 0], tangents[0]) @ base
        gripper = Pose.from_rotation(gripper.position, base)
    frames = _carried(base, tangents)
    torsion = np.zeros(mesh.s.size)
    if far_end.grip == 'clamped':
        natural = float(mesh.natural[:, 0] @ mesh.free.lengths)
        missing = float(turn_between(frames[-1], far_end.pose.rotation) @ tangents[-1])
        missing += 2 * np.pi * round((natural - missing) / (2 * np.pi))
        soft = np.cumsum(mesh.free.lengths / mesh.free.stiffness[:, 0])
        torsion[1:] = missing * soft / soft[-1]
    frames = frames @ Rotation.from_rotvec(torsion[:, None] * [1.0, 0.0, 0.0]).as_matrix()
    turns = Rotation.from_matrix(frames[:-1].transpose(0, 2, 1) @ frames[1:]).as_rotvec()
    strains = turns / mesh.free.lengths[:, None]
    moment = frames[-1] @ (mesh.free.stiffness[-1] * (strains[-1] - mesh.natural[-1]))
    last = force + string.pulls[-1] + mesh.free.load.pull[-1]
    rows = far_end.held
    held = -(rows[:, :3] @ moment / mesh.lever + rows[:, 3:] @ last)
    return gripper, strains, replace(memory, hold=held), True


class _String:
    """Tangents of a string under dead loads, that turns into its clamps, by its mean force."""

    def __init__(self, mesh: Discretization, part: Stretch, span: Span) -> None:
        self.pulls, self._span, self._length = _pulls(mesh, part), span, float(mesh.s[-1])
        self._middles = 0.5 * (mesh.s[1:] + mesh.s[:-1])
        self._stiffness = mesh.free.stiffness[:, 1:].mean(axis=1)
        self._clamps, self._away = part.tangents, part.end - part.begin
        ends = [_spread(bend, self._length) for bend in span.bends]
        s = np.concatenate([ends[0], self._length - ends[1][-2::-1]])
        self._points = np.sort(np.append(s, 0.5 * (s[1:] + s[:-1])))
        h = np.diff(s)
        self._weights = np.zeros(self._points.size)  # Simpson's
        self._weights[:-1:2] += h / 6
        self._weights[1::2] += 2 * h / 3
        self._weights[2::2] += h / 6

    def tangents(self, force: Floats, s: Floats) -> Floats:
        """Return (n, 3) unit vectors at s (n,), m, where the mean force is `force` (3,), N."""
        along = force + np.column_stack([np.interp(s, self._middles, pull)
                                         for pull in self.pulls.T])
        tension = np.sqrt((along * along).sum(axis=1))
        tangents: Floats = along / tension[:, None]
        rate = np.sqrt(tension / np.interp(s, self._middles, self._stiffness))
        passed = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(s))])
        for clamp, before, at in ((self._clamps[1], passed[-1] - passed, -1),
                                  (self._clamps[0], passed, 0)):
            if clamp is None:
                continue
            turn = turn_between(np.eye(3), _turned(along[at] / tension[at], clamp))
            angle = sqrt(turn @ turn)
            if angle > 0:
                left = 4 * np.arctan(np.tan(angle / 4) * np.exp(-before))
                tangents = Rotation.from_rotvec(np.outer(left / angle, turn)).apply(tangents)
        return tangents

    def force(self) -> Floats | None:
        """Return (3,) the mean force, N, with which it spans its way; None if none is found."""
        way = self._span.way
        across = np.linalg.svd(way[None])[2][1:]

        begin = log(self._span.tension)

        def force_of(x: Floats) -> Floats:
            # a trial of the solver may go far off, where exp is no number any more
            result: Floats = exp(np.clip(x[0], begin - _FAR, begin + _FAR)) * (
                way + x[1:] @ across)
            return result

        def left(x: Floats) -> Floats:
            end = self._weights @ self.tangents(force_of(x), self._points)
            slack = max(self._length - float(end @ way), 1e-300)
            return np.append(log(slack / self._span.slack),
                             across @ (end - self._away) / self._span.slack)

        found = root(left, [begin, 0.0, 0.0], options={'maxfev': _TRIALS})
        return force_of(found.x) if np.abs(found.fun).max() < _CLOSE else None


def _spread(bend: float, length: float) -> Floats:
    """Return (n,) points from an end of the DLO to its middle, near ones in its bend, m."""
    points, most = [0.0], length / _POINTS
    while points[-1] < 0.5 * length:
        points.append(points[-1] + min(most, _POINT * min(bend, length) + _GROWTH * points[-1]))
    return 0.5 * length / points[-1] * np.array(points)


def _turned(one: Floats, other: Floats) -> Floats:
    """Return (3, 3) the least rotation that takes a unit vector (3,) to another."""
    axis = np.cross(one, other)
    sine, cosine = sqrt(axis @ axis), float(one @ other)
    if sine < 1e-12:
        axis, sine = np.linalg.svd(one[None])[2][1], 0.0 if cosine > 0 else 1e-12
        axis = sine * axis
    angle = np.arctan2(sine, cosine)
    result: Floats = Rotation.from_rotvec(axis * (angle / sine if sine else 0.0)).as_matrix()
    return result


def _carried(base: Floats, tangents: Floats) -> Floats:
    """Return (n, 3, 3) frames, from `base` on, that turn no more than their tangents (n, 3) do."""
    axes = np.cross(tangents[:-1], tangents[1:])
    sines = np.sqrt((axes * axes).sum(axis=1))
    cosines = (tangents[:-1] * tangents[1:]).sum(axis=1)
    scale = np.divide(np.arctan2(sines, cosines), sines, out=np.ones_like(sines),
                      where=sines > 0)
    frames = [_turned(base[:, 0], tangents[0]) @ base]
    for turn in Rotation.from_rotvec(scale[:, None] * axes).as_matrix():
        frames.append(turn @ frames[-1])
    return np.array(frames)
