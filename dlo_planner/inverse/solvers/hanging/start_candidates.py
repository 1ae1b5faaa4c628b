# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a threading can begin: the free end alone is prescribed, in place and direction."""

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from dlo_planner.direct.statics import shape_of
from dlo_planner.energy.potential import placed
from dlo_planner.inverse.solvers.hanging.marching import integrate_from_tip
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.model.pose import Pose, angle_between

_ALIKE = 1e-9  # part of the stiffness, rad along the length: what makes no difference
_ROLLS = 24  # of the free end, tried


def start_candidates(simulator, cutout, start):
    """Yield what a threading can begin with: Shape, reference (3, 3) for its roll, depth 0.

    The Shape's free end points along the normal.

    The free end's roll about the normal is a choice. The first one is made so that the gripper is
    not rolled: seen along its own axis it stands as `start` does (or upright, without one). A
    curved DLO may have several such rolls; the one that turns the gripper least comes first. All
    others follow in steps, unless the DLO is round and straight and one roll is like another.
    """
    upright = Pose.looking_along((0.0, 0.0, 0.0), cutout.normal).rotation
    wanted = upright
    if start is not None:
        wanted = least_turn(start.direction, cutout.normal) @ start.rotation
    discretization = simulator.discretization(Pose.from_rotation((0, 0, 0), upright), None)
    system = discretization.system(upright)

    def end_rolled(angle):
        """Return strains, gripper rotation, and the reference of its roll."""
        turn = Rotation.from_rotvec(angle * cutout.normal).as_matrix()
        strains, base = integrate_from_tip(system, turn @ wanted)
        return strains, base, least_turn(wanted[:, 0], base[:, 0]) @ wanted

    def roll(angle):
        _, base, reference = end_rolled(angle)
        across = reference.T @ base[:, 1]
        return np.arctan2(across[2], across[1])

    def turn_against_start(angle):
        return angle_between(end_rolled(angle)[1], wanted)

    if is_axisymmetric(simulator):
        # rolled about itself, the DLO carries the gripper along
        strains, base, reference = end_rolled(-roll(0.0))
        yield _shape_at(discretization, strains, base), reference, 0.0
        return
    angles = np.linspace(-np.pi, np.pi, _ROLLS + 1)
    rolls = [roll(angle) for angle in angles]
    roots = [brentq(roll, angles[k], angles[k + 1], xtol=1e-12) for k in range(_ROLLS)
             if rolls[k] * rolls[k + 1] <= 0 and abs(rolls[k] - rolls[k + 1]) < np.pi]
    for root in sorted(roots, key=turn_against_start):
        strains, base, reference = end_rolled(root)
        yield _shape_at(discretization, strains, base), reference, 0.0
    for angle in sorted(angles[:-1:2], key=turn_against_start):
        strains, base, _ = end_rolled(angle)
        yield _shape_at(discretization, strains, base), base, 0.0


def with_free_end(simulator, end):
    """Return the Shape (a guess) whose free end has the frame `end` (3, 3)."""
    discretization = simulator.discretization(Pose.from_rotation((0, 0, 0), end), None)
    strains, base = integrate_from_tip(discretization.system(end), np.array(end, order='C'))
    return _shape_at(discretization, strains, base)


def is_axisymmetric(simulator):
    """Whether the DLO is straight and equally stiff all around: its roll makes no difference."""
    rod = simulator.rod
    s = np.linspace(0, rod.length, 65)
    natural, (_, one, other) = rod.mean_natural_strains(s), rod.mean_stiffnesses(s).T
    return (bool((abs(one - other) <= _ALIKE * one).all())
            and np.abs(natural).max() * rod.length <= _ALIKE)


def least_turn(one, other):
    """Return the rotation (3, 3) about the axis across both that takes unit vector one to other."""
    return Rotation.from_rotvec(_rotvec_between(one, other)).as_matrix()


def _rotvec_between(one, other):
    axis = np.cross(one, other)
    sine = np.linalg.norm(axis)
    if sine < 1e-12:
        if one @ other > 0:
            return np.zeros(3)
        helper = np.eye(3)[np.argmin(np.abs(one))]  # opposite: any axis across will do
        axis = np.cross(one, helper)
        sine = np.linalg.norm(axis)
        return axis / sine * np.pi
    return axis / sine * np.arctan2(sine, one @ other)


def _shape_at(discretization, strains, base):
    """Return a Shape with these strains, whether in equilibrium or not (a guess)."""
    gripper = Pose.from_rotation((0.0, 0.0, 0.0), base)
    system = discretization.system(base)
    state = placed(system, strains)
    return shape_of(discretization, gripper, Minimum(state, np.inf, -np.inf, 0, 0, system))
