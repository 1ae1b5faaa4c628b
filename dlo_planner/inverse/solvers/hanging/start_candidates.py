# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a threading can begin: the free end alone is prescribed, in place and direction."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.statics import shape_of
from dlo_planner.energy.potential import configuration_at
from dlo_planner.inverse.solvers.hanging.marching import integrate_from_tip
from dlo_planner.minimize.convergence import Minimum
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose, angle_between, turned_by
from dlo_planner.model.rod import Rod

_ALIKE = 1e-9  # part of the stiffness, rad along the length: what makes no difference
_ROLLS = 24  # of the free end, tried
_OPPOSITE = 1e-9  # 1 + cosine of two unit vectors


class Candidate(NamedTuple):
    """A shape with which a threading can begin.

    Attributes
    ----------
    shape : Shape
        Shape near the first one.
    reference : ndarray, shape (3, 3)
        Rotation of the gripper since which it must not roll.
    depth : float
        Depth of the shape, m.
    """

    shape: Shape
    reference: Floats
    depth: float


def start_candidates(simulator: DirectSimulator, cutout: CutOut,
                     start: Pose | None) -> Iterator[Candidate]:
    """Yield the Candidates for a threading: their free ends point along the normal, at depth 0.

    The free end's roll about the normal is a choice. With the first candidate the gripper is not
    rolled: seen along its own axis it stands as `start` does (or upright, without one). A curved
    DLO may have several such rolls; the one that turns the gripper least comes first. The others
    follow in steps, unless the DLO is round and straight, so that all rolls are alike.
    """
    upright = Pose.looking_along((0.0, 0.0, 0.0), cutout.normal).rotation
    preferred = upright
    if start is not None:
        preferred = least_turn(start.direction, cutout.normal) @ start.rotation
    discretization = simulator.discretization(Pose.from_rotation((0, 0, 0), upright), None)
    system = discretization.system(upright)

    def end_rolled(angle: float) -> tuple[Floats, Floats, Floats]:
        """Return strains, gripper rotation, and the reference of its roll."""
        strains, base = integrate_from_tip(system, turned_by(angle * cutout.normal) @ preferred)
        return strains, base, least_turn(preferred[:, 0], base[:, 0]) @ preferred

    def roll(angle: float) -> float:
        _, base, reference = end_rolled(angle)
        across = reference.T @ base[:, 1]
        return float(np.arctan2(across[2], across[1]))

    def turn_against_start(angle: float) -> float:
        return angle_between(end_rolled(angle)[1], preferred)

    if is_axisymmetric(simulator.rod):
        # rolled about itself, the DLO carries the gripper along
        strains, base, reference = end_rolled(-roll(0.0))
        yield Candidate(_shape_at(discretization, strains, base), reference, 0.0)
        return
    angles = np.linspace(-np.pi, np.pi, _ROLLS + 1)
    rolls = [roll(angle) for angle in angles]
    roots = [brentq(roll, angles[k], angles[k + 1], xtol=1e-12) for k in range(_ROLLS)
             if rolls[k] * rolls[k + 1] <= 0 and abs(rolls[k] - rolls[k + 1]) < np.pi]
    for root in sorted(roots, key=turn_against_start):
        strains, base, reference = end_rolled(root)
        yield Candidate(_shape_at(discretization, strains, base), reference, 0.0)
    for angle in sorted(angles[:-1:2], key=turn_against_start):
        strains, base, _ = end_rolled(angle)
        yield Candidate(_shape_at(discretization, strains, base), base, 0.0)


def with_free_end(simulator: DirectSimulator, end: Floats) -> Shape:
    """Return the Shape (a guess) whose free end has the frame `end` (3, 3)."""
    discretization = simulator.discretization(Pose.from_rotation((0, 0, 0), end), None)
    strains, base = integrate_from_tip(discretization.system(end), np.array(end, order='C'))
    return _shape_at(discretization, strains, base)


def is_axisymmetric(rod: Rod) -> bool:
    """Whether a Rod is straight and equally stiff all around: its roll makes no difference."""
    s = np.linspace(0, rod.length, 65)
    natural, (_, one, other) = rod.mean_natural_strains(s), rod.mean_stiffnesses(s).T
    return (bool((abs(one - other) <= _ALIKE * one).all())
            and np.abs(natural).max() * rod.length <= _ALIKE)


def least_turn(one: Floats, other: Floats) -> Floats:
    """Return the rotation (3, 3) about the axis across both that takes unit vector one to other."""
    (a, b, c), (d, e, f) = one.tolist(), other.tolist()
    x, y, z, cosine = b * f - c * e, c * d - a * f, a * e - b * d, a * d + b * e + c * f
    if 1.0 + cosine < _OPPOSITE:  # any perpendicular axis
        across = np.cross(one, np.eye(3)[np.argmin(np.abs(one))])
        return turned_by(across / np.linalg.norm(across) * np.pi)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: Floats = np.eye(3) + cross + cross @ cross / (1.0 + cosine)  # Rodrigues
    return turn


def _shape_at(discretization: Discretization, strains: Floats, base: Floats) -> Shape:
    """Return a Shape with these strains, whether in equilibrium or not (a guess)."""
    gripper = Pose.from_rotation((0.0, 0.0, 0.0), base)
    system = discretization.system(base)
    state = configuration_at(system, strains)
    shape: Shape = shape_of(discretization, gripper,
                            Minimum(state, np.inf, -np.inf, 0, 0, system))
    return shape
