# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The rest of a plan, aimed anew for the estimated DLO: its own goals, with another DLO.

At each remaining waypoint that passes a place, the estimated DLO passes where the planned one does.
The equilibrium and the gripper's pose are found together, as planning does (`waypoint_newton`),
starting from the shape known there. The estimated offset of the gripper is then taken off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.blas import one_thread
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.energy.loads import node_forces
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.so3 import turn_between
from dlo_planner.identify.estimate import Estimate, PredictedMiss, miss_of, passages_in
from dlo_planner.inverse.route import thinned
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.waypoint_newton import follow, free_axis
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import flag, instance, integer, items, results
from dlo_planner.model.pose import Pose, displaced
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Value, brief, put
from dlo_planner.plan.clearance import Bodies
from dlo_planner.plan.goal_rows import (
    DIRECTION,
    POSITION,
    ROLL,
    ROTATION,
    THROUGH,
    GoalTable,
)
from dlo_planner.plan.goals import DirectionAt, GripperNear, PositionAt, Residuals
from dlo_planner.plan.plan import OBLIQUE, Plan, moved_sheet
from dlo_planner.plan.waypoint import Waypoint, length_of
from dlo_planner.uncertainty.state import stretched

_LOOKED_AT = 3   # waypoints at which the miss that remains is predicted
_STILL = 1e-3    # weight of the planned gripper, which decides only what is left free
_IN_CONTACT = 12  # steps of Gauss and Newton
_THERE = 1e-5    # rad, and of the length: the last of them, which leaves about its square
_TURN = 0.5      # rad, and of the length: how far the gripper may go to what it need not reach
_SAME = 1e-12    # of the length: a rod that is as long is the whole one
_OTHER = 0.1     # of the length: a DLO whose length differs by more is another one


@dataclass(frozen=True, eq=False, repr=False)
class Correction(Value):
    """New gripper poses for the m waypoints of a plan from `first` on.

    Attributes
    ----------
    first : int
        Index of the first of them in the plan.
    grippers : tuple of Pose
        The m poses to command.
    offsets : ndarray, shape (m, 6)
        Offsets from the plan's poses to these: rotation vector about the gripper's origin, rad,
        then displacement, m; world axes.
    miss : PredictedMiss
        PredictedMiss that remains, at three of the waypoints that pass a place, the first and the
        last among them; nan where it is not known, of a DLO in a bore or in contact.
    converged : bool
        Whether every waypoint could be aimed; if not, the poses are the plan's, and a new plan is
        needed.
    shapes : tuple of Shape
        The m shapes: of the estimated DLO where a place is passed, else the plan's.
    violation : str or None
        The demand on plans that the corrected ones break, in words, '' if none. None: nobody has
        looked, no `inverse` was given.
    """

    first: int
    grippers: tuple[Pose, ...]
    offsets: Floats
    miss: PredictedMiss
    converged: bool
    shapes: tuple[Shape, ...]
    violation: str | None = None

    def __post_init__(self) -> None:
        grippers = items('Correction.grippers', self.grippers, Pose)
        shapes = items('Correction.shapes', self.shapes, Shape)
        if len(shapes) != len(grippers):
            raise InvalidTask(f'Correction.shapes has {len(shapes)} entries: expected one per '
                              f'entry of Correction.grippers, {len(grippers)}')
        put(self, first=integer('Correction.first', self.first, minimum=0, maximum=10**9),
            grippers=grippers, shapes=shapes,
            offsets=results('Correction.offsets', self.offsets, (len(grippers), 6)),
            miss=instance('Correction.miss', self.miss, PredictedMiss),
            converged=flag('Correction.converged', self.converged))
        instance('Correction.violation', self.violation, str, optional=True)
        super().__post_init__()

    def __repr__(self) -> str:
        moved = np.linalg.norm(self.offsets[:, 3:], axis=1).max(initial=0.0)
        return brief(self, f'{len(self.grippers)} waypoints from {self.first} on',
                     '' if self.converged else 'not converged', self.violation or '',
                     f'moved up to {moved:.2g} m',
                     f'miss with 95 % up to {self.miss.bound.max(initial=0.0):.2g} m')


@one_thread()
def correct(estimate: Estimate, plan: Plan, first: int = 0, before: Correction | None = None, *,
            inverse: InverseSimulator | None = None) -> Correction:
    """Return the Correction of the remaining waypoints of a plan, of any task.

    At each waypoint that passes a place, the DLO passes where the planned one does: a cut-out along
    the same direction, two and more at once, the entrance of a bore with the same frame, places of
    a contact along its direction, as if nothing rubbed there. What that leaves free stays as
    planned. Where the plan passes a cut-out obliquely, the place counts, and the direction as much
    as that the gripper turns little: what is softer than planned might not reach that direction, or
    only where it hardly stays. A waypoint before these is displaced like the first of them. The
    poses are quasi-static; `CorrectedTrajectory` blends them into a motion.

    Parameters
    ----------
    estimate : Estimate
        Estimate of the DLO that the plan is for.
    plan : Plan
        Plan in commanded poses, unchanged since it was made.
    first : int, optional
        Index of the waypoint to which the gripper goes next.
    before : Correction, optional
        An earlier Correction of the same plan, whose shapes begin the search. If None, those of the
        plan.
    inverse : InverseSimulator, optional
        Its demands are looked at as those on a plan: workspace, obstacles and holes, bends and
        stability at the corrected waypoints. If None, they are not.

    Raises
    ------
    InvalidTask
        An argument makes no sense.
    """
    instance('estimate', estimate, Estimate)
    if not len(instance('plan', plan, Plan)):
        raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
    instance('inverse', inverse, InverseSimulator, optional=True)
    first = integer('first', first, minimum=0, maximum=len(plan) - 1)
    aim = _Aim(estimate, plan)
    known = _known(plan, instance('before', before, Correction, optional=True))
    rest = range(first, len(plan))
    shapes: dict[int, Shape] = {}
    for k in rest:
        if plan.via_points[k]:
            shape = aim.shape(k, known[k])
            if shape is None:
                return Correction(
                    first, tuple(plan.grippers[k] for k in rest), np.zeros((len(rest), 6)),
                    aim.miss([k for k in rest if plan.via_points[k]]), False,
                    tuple(plan.shapes[k] for k in rest))
            shapes[k] = shape
    grippers = {k: aim.commanded(shape.gripper) for k, shape in shapes.items()}
    moved = dict(zip(grippers, _offsets([plan.grippers[k] for k in grippers],
                                        list(grippers.values())), strict=True))
    offsets = np.zeros((len(rest), 6))
    for k in rest:  # a waypoint before those that pass the center moves like the first of them
        source = next((j for j in moved if j >= k), None)
        offsets[k - first] = 0.0 if source is None else moved[source]
        if k not in grippers:
            grippers[k] = displaced(plan.grippers[k], offsets[k - first])
    violation = None if inverse is None else _violation(aim, plan, shapes, grippers, inverse)
    return Correction(first, tuple(grippers[k] for k in rest), offsets,
                      aim.miss([k for k in rest if k in shapes], shapes), True,
                      tuple(shapes.get(k, plan.shapes[k]) for k in rest), violation)


def _violation(aim: _Aim, plan: Plan, shapes: dict[int, Shape], grippers: dict[int, Pose],
               inverse: InverseSimulator) -> str:
    """Return the first demand that a corrected waypoint breaks, in words, '' if none."""
    moved = [(moved_sheet(sheet, aim.shift), normal) for sheet, normal in plan.sheets]
    demands = inverse.demands(plan)
    demands = replace(demands, obstacles=aim.estimate.moved_obstacles(demands.obstacles, np.array([
        center for passes in plan.via_points for center, _, _ in passes]).reshape(-1, 3)))
    holes = Bodies(moved, (), demands.surface)
    for k, commanded in sorted(grippers.items()):
        shape = shapes.get(k, plan.shapes[k])
        broken = demands.violation(Waypoint(
            shape, position_error=aim.missed(k, shape) if k in shapes else 0.0,
            clearances=tuple(holes.holes(shape)) if k in shapes else ()), commanded)
        if broken is not None:
            return f'waypoint {k}: {broken.message}'
    return ''


def _known(plan: Plan, before: Correction | None) -> list[Shape]:
    """Return the Shape for each waypoint of the plan from which the search begins."""
    shapes = list(plan.shapes)
    if before is not None:
        if before.first + len(before.shapes) != len(plan):
            raise InvalidTask(f'before = {before!r}: expected a Correction of the same plan')
        shapes[before.first:] = before.shapes
    return shapes


class _Aim:
    """Aims the DLO of an Estimate at the places that a Plan passes."""

    def __init__(self, estimate: Estimate, plan: Plan) -> None:
        self.estimate, self._plan, self._offset = estimate, plan, estimate.gripper_offset
        self.shift = estimate.center(np.zeros(3))
        self._meshes: dict[int, Discretization] = {}
        self._simulators: dict[int, DirectSimulator] = {}
        # from the planned gripper: what is expected of a waypoint in contact, and was of the last
        self._twist = np.zeros(6)
        self._last: Floats | None = None
        self._touching_shape: Shape | None = None  # of the last waypoint in contact
        length = estimate.uncertain.simulator.rod.length
        for shape in plan.shapes:
            s = shape.s[-1] / length - 1
            if shape.state.mesh is None or shape.parts is not None or s > _OTHER or (
                    s < -_OTHER and not shape.holds):
                raise InvalidTask('plan: expected shapes of the DLO that is estimated')

    def shape(self, index: int, guess: Shape) -> Shape | None:
        """Return the Shape that passes the places of a waypoint, or None."""
        planned = self._plan.shapes[index]
        if planned.contacts:
            shape = self._in_contact(index, guess)
        else:
            mesh, (goals, free) = self._mesh(planned), self._goals(index)
            many = np.sum(goals.kind == THROUGH) > 1  # first two, then all
            further = (goals.kind == THROUGH) & (np.cumsum(goals.kind == THROUGH) > 1)
            two = goals._replace(weight=goals.weight * ~further)
            reach = _TURN, _TURN / goals.weight[0]
            found = follow(mesh, guess, two, goals.s[None], free, origin=guess.gripper.position,
                           reach=reach if self._oblique(index) else None)
            if many and found:
                soft = goals._replace(weight=np.where(goals.kind == ROLL, _STILL, goals.weight))
                found = follow(mesh, found[0].shape, soft, goals.s[None], free,
                               origin=found[0].shape.gripper.position, reach=reach)
            shape = found[0].shape if found else None
        return None if shape is None or shape.stability < -NEUTRAL else shape

    def _oblique(self, index: int) -> bool:
        """Return whether a waypoint passes one cut-out obliquely, in a direction of its own."""
        return (len(self._plan.via_points[index]) == 1 and not self._plan.shapes[index].holds
                and bool(self._plan.misalignment[index] > OBLIQUE))

    def _goals(self, index: int) -> tuple[GoalTable, Floats]:
        """Return the goals of a waypoint, and the direction about which it may roll."""
        planned, passes = self._plan.shapes[index], self._plan.via_points[index]
        rotation, length = np.array(self._plan.grippers[index].rotation), float(planned.s[-1])
        frames = [planned.frame_at(min(at, length)) for _, at, _ in passes]
        places = [position + (at - min(at, length)) * axes[:, 0] + self.shift
                  for (axes, position), (_, at, _) in zip(frames, passes, strict=True)]
        weight, s = 1 / self.estimate.uncertain.simulator.rod.length, passes[0][1]
        free = np.array(frames[0][0][:, 0] if passes[0][2] is None else passes[0][2])
        rows = [(POSITION, places[0], rotation, weight),
                *((THROUGH, place, rotation, weight) for place in places[1:])]
        if planned.far_end is not None:  # the entrance of a bore: the whole frame
            s = self._mesh(planned).s[-1]
            rows.append((ROTATION, free, np.array(frames[0][0]), 1.0))
        else:
            if len(places) == 1:
                rows.append((DIRECTION, free, rotation, 1.0))
            else:
                free = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
            # a turn of the gripper by 1 rad counts as much as 1 rad of the direction: so that is
            # followed as far as the gripper turns the DLO more than itself, not into a fold
            rows.append((ROTATION, free, np.array(planned.gripper.rotation), 1.0)
                        if self._oblique(index) else
                        (ROLL, free_axis(rotation, free), rotation, 1.0))
        kinds, targets, axes, weights = map(np.array, zip(*rows, strict=True))
        arc_lengths = np.full(len(rows), s)
        if self._oblique(index):
            arc_lengths[-1] = 0.0  # the gripper
        return GoalTable(kinds, arc_lengths, targets, axes, weights), free

    def _in_contact(self, index: int, guess: Shape) -> Shape | None:
        """Return the Shape that touches where the planned one does, by Gauss and Newton."""
        planned, (_, s, _) = self._plan.shapes[index], self._plan.via_points[index][0]
        axes, place = planned.frame_at(s)
        length = float(planned.s[-1])
        goals: list[Residuals] = [PositionAt(s, place, 1 / length), DirectionAt(s, axes[:, 0]),
                 GripperNear(planned.gripper, _STILL / length)]
        simulator, scale = self._touching(planned), np.array([1.0] * 3 + [length] * 3)
        begin = displaced(guess.gripper, self._twist) if guess is planned else guess.gripper
        shape = simulator.solve(begin, self._touching_shape or stretched(
            guess, simulator.rod.length))
        for _ in range(_IN_CONTACT):
            if not shape.converged:
                return None
            sensitivity = Sensitivity(shape)
            rows = np.vstack([goal.slopes(shape, sensitivity) for goal in goals])
            missed = np.concatenate([goal.residuals(shape) for goal in goals])
            step = np.linalg.lstsq(rows * scale, -missed, rcond=None)[0]
            shape = simulator.solve(displaced(shape.gripper, step * scale), shape)
            if np.abs(step).max() < _THERE:
                twist = np.append(
                    turn_between(planned.gripper.rotation, shape.gripper.rotation),
                    shape.gripper.position - planned.gripper.position)
                before = twist if self._last is None else self._last
                self._last, self._twist = twist, 2 * twist - before
                self._touching_shape = shape
                return shape if shape.converged and shape.contacts else None
        return None

    def _touching(self, planned: Shape) -> DirectSimulator:
        """Return a simulator of the estimated DLO among what surrounds a planned Shape."""
        mesh = planned.state.made_on
        if id(mesh) not in self._simulators:
            around = mesh.surroundings
            touching = DirectSimulator(
                around.rod, obstacles=around.obstacles, gravity=around.gravity, load=around.load,
                point_loads=around.point_loads, basis=mesh.basis, n_elements=mesh.s.size - 1,
                n_terms=None if mesh.basis == 'local' else mesh.n_terms)
            # the steps of the search are no way along which anything rubs
            self._simulators[id(mesh)] = touching.with_rod(self.estimate.rod).with_friction(0.0)
        return self._simulators[id(mesh)]

    def commanded(self, gripper: Pose) -> Pose:
        """Return `Estimate.commanded`, quickly."""
        rotation = gripper.rotation @ self._offset.rotation.T
        return Pose.from_rotation(gripper.position - rotation @ self._offset.position, rotation)

    def miss(self, passing: list[int], shapes: dict[int, Shape] | None = None) -> PredictedMiss:
        """Return the PredictedMiss at some of the waypoints; nan of one in a bore or in contact."""
        waypoints = thinned(np.array(passing, dtype=int), _LOOKED_AT).tolist()
        if all(not self._plan.shapes[k].holds and not self._plan.shapes[k].contacts
               for k in waypoints):
            return miss_of(self.estimate, self._plan, waypoints,
                           None if shapes is None else [shapes[k] for k in waypoints])
        count = len(waypoints)
        return PredictedMiss(np.array(waypoints, dtype=float), np.full((count, 3), np.nan),
                             np.full((3 * count, 3 * count), np.nan), np.full(count, np.nan))

    def missed(self, index: int, shape: Shape) -> float:
        """Return by how much a Shape misses the places of a waypoint, m."""
        return max(length_of(goal.residuals(shape))
                   for goal in passages_in(self.estimate, self._plan.via_points[index]))

    def _mesh(self, planned: Shape) -> Discretization:
        """Return the Discretization of the estimated DLO like that of a planned Shape."""
        mesh = planned.state.made_on
        if id(mesh) not in self._meshes:  # waypoints share them
            whole = self.estimate.uncertain.simulator.rod.length
            if planned.far_end is None or abs(mesh.s[-1] - whole) <= _SAME * whole:
                uncertain = self.estimate.uncertain
                known = uncertain.mesh(mesh).at(
                    self.estimate.mean[:uncertain.parameters.size])
            else:
                known = self._outside(mesh, whole)
            self._meshes[id(mesh)] = known
        return self._meshes[id(mesh)]

    @cached_property
    def _straight(self) -> Rod:
        """The estimated Rod, straight: one whose natural curvature is a series is slow to mesh."""
        parameters = self.estimate.uncertain.parameters
        x = self.estimate.mean[:parameters.size].copy()
        x[parameters.columns('natural_curvature')[0]] = 0.0
        return parameters.at(x)

    def _outside(self, planned: Discretization, whole: float) -> Discretization:
        """Return the estimated DLO before a bore, whose entrance bears what it should of masses."""
        parameters, rod, around = self.estimate.uncertain.parameters, self._straight, (
            planned.surroundings)
        x, free = self.estimate.mean[:parameters.size], planned.free
        outside = rod.length - (whole - planned.rod.length)
        s = planned.s * (outside / planned.s[-1])
        # what is fixed to the planned part, and the part itself, on the nodes
        own = -planned.rod.node_masses(planned.s)[:, None] * around.gravity
        forces = node_forces(around, planned.s)
        fixed = parameters.mass_factors(x)[2] * (free.load.pull + forces - own)
        # the series of the whole DLO, of which this is a part
        means = parameters.means(np.append(s, rod.length))[:s.size - 1]
        return planned.varied(
            lengths=np.diff(s), stiffness=rod.mean_stiffnesses(s),
            natural=rod.mean_natural_strains(s) + means @ parameters.coefficients(x),
            pull=fixed - forces - rod.node_masses(s)[:, None] * around.gravity)


def _offsets(planned: Sequence[Pose], grippers: Sequence[Pose]) -> Floats:
    """Return (k, 6) the rotation vectors and displacements from k Poses to others."""
    if not grippers:
        return np.zeros((0, 6))
    turns = Rotation.from_matrix(np.array([one.rotation @ other.rotation.T for other, one in zip(
        planned, grippers, strict=True)])).as_rotvec()
    return np.hstack([turns, [one.position - other.position for other, one in zip(
        planned, grippers, strict=True)]])
