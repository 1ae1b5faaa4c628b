# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cases of the inverse simulation: a plan of every task, refused or not, and what follows of it."""

import numpy as np

from benchmarks.oracle.answers import Answer, Scale
from benchmarks.oracle.contacts import body
from benchmarks.oracle.shapes import of_shape
from dlo_planner import (
    Capsule,
    CutOut,
    DirectSimulator,
    HoldContact,
    Insert,
    InverseSimulator,
    Minimize,
    Plane,
    Pose,
    Rod,
    Sheet,
    SlideContact,
    Sphere,
    Thread,
    ThreadSequence,
    ThreadTwo,
    Trajectory,
    Uncertainty,
    Workspace,
    replay,
    robustness,
)
from dlo_planner.penalties import (
    AwayFrom,
    BentAtMost,
    DirectionAt,
    GripperNear,
    KeepTangent,
    PositionAt,
    Through,
)
from dlo_planner.tasks import Requirements

PLANNED = 1e-6      # of the length: places of the gripper
_HOW = {'basis': 'local', 'n_elements': 64}, {'n_elements': 64, 'n_terms': 10}, {'accuracy': 1e-4}
_PLACES = np.arange(1, 10) / 9
_WAYPOINTS = 5      # of a plan, whose grippers are frozen


def of_plan(plan, rod, loose=PLANNED):
    """Return the Answer of a Plan."""
    answer, scale = Answer(), Scale.of(rod)
    answer.say('status', plan.status.value)
    answer.put('waypoints', len(plan), 0.0)
    weak = float(np.clip(0.1 / max(plan.stability.min(), 1e-12), 1.0, 100.0))
    loose = loose * weak
    chosen = np.unique(np.linspace(0, len(plan) - 1, _WAYPOINTS).round().astype(int))
    grippers = [plan.grippers[k] for k in chosen]
    answer.put('gripper places', [pose.position for pose in grippers], loose * scale.length)
    answer.put('gripper axes', [pose.rotation[:, :2] for pose in grippers], 10 * loose)
    answer.put('depths', plan.depths[chosen], loose * scale.length)
    shape = plan.shapes[-1]
    answer.put('positions', shape.positions_at(_PLACES * shape.s[-1]), 3 * loose * scale.length)
    answer.put('energy', shape.elastic_energy, 10 * loose * scale.energy)
    answer.put('stability', plan.stability.min(), max(1e-3, 100 * loose))
    answer.put('duration', plan.times[-1], 30 * loose * (1.0 + plan.times[-1]))
    answer.put('position_error', plan.position_error.max(), 3 * loose * scale.length)
    answer.put('misalignment', plan.misalignment.max(), 10 * loose)
    answer.put('clearance', plan.clearance.min(), 10 * loose * scale.length)
    answer.put('fraction', plan.fraction, 1e-9)
    push = plan.insertion_force
    if np.isfinite(push).any():
        answer.put('insertion_force', np.nanmax(push), 100 * loose * max(
            scale.force, np.nanmax(np.abs(push))))
    force = sum(one.force for one in shape.contacts)
    if shape.contacts:
        answer.put('force', force, 100 * loose * max(force, scale.force))
    return answer


def planned_rod(given):
    """Return a Rod of 1 m, such as plans are made for: round, flat, bent, twisted."""
    kind = given.rng.integers(4)
    stiffness = [given.between(0.03, 1) for _ in range(2)]
    if kind == 0:
        stiffness[1] = stiffness[0]
    bent = given.rng.normal(size=2) * 0.4 if kind >= 2 else np.zeros(2)
    return Rod(1.0, 0.05, tuple(stiffness), given.between(0.1, 1), natural_curvature=tuple(bent),
               natural_twist=given.rng.normal() * 0.5 if kind == 3 else 0.0,
               tip_mass=given.rng.uniform(0, 0.02) if kind == 3 else 0.0, radius=1e-3)


def _inverse(given, obstacles=(), **more):
    rod = planned_rod(given)
    return InverseSimulator(DirectSimulator(rod, obstacles=obstacles, **_HOW[given.number % 3]),
                            **more), rod


def _hole(given, **size):
    """Return a CutOut, every other one so that it may be threaded without much ado."""
    way = given.direction()
    if given.number % 2:
        way[2] = 0.5 * way[2] - 0.2
    return CutOut(given.along(given.rng.normal(size=3), way), **size)


def thread(given):
    """Thread through a cut-out anywhere."""
    inverse, rod = _inverse(given)
    depths = None if given.number % 5 == 0 else np.linspace(0, given.rng.uniform(0.5, 0.95), 10)
    task = Thread(_hole(given, radius=0.02), depths,
                  as_deep_as_possible=given.number % 4 == 1,
                  gripper_clearance=0.1 if given.number % 7 == 3 else None, max_misalignment=0)
    start = given.anywhere() if given.number % 3 == 0 else None
    return of_plan(inverse.plan(task, start=start), rod)


def nested(given):
    """Thread by the paper's nested search."""
    inverse, rod = _inverse(given)
    return of_plan(inverse.plan(Thread(_hole(given), np.linspace(0, 0.6, 4), 'nested')), rod,
                   100 * PLANNED)


def thread_beside(given):
    """Thread through a sheet, beside an obstacle, in a workspace, a stability demanded."""
    hole = _hole(given, radius=0.03)
    side = np.cross(hole.normal, given.direction())
    side /= np.linalg.norm(side)
    place = hole.center + side * given.rng.uniform(0.12, 0.5) - 0.4 * hole.normal
    obstacles = [Sheet.around(hole, 0.6, 0.6)]
    if given.number % 2:
        obstacles.append(Sphere(place, 0.1))
    room = Workspace(hole.center - 1.5, hole.center + 1.5) if given.number % 3 == 0 else None
    inverse, rod = _inverse(given, obstacles, workspace=room)
    demands = Requirements(workspace=room, stability=0.01 if given.number % 4 == 0 else 3e-4)
    task = Thread(hole, np.linspace(0, 0.7, 8), max_misalignment=0)
    return of_plan(inverse.plan(task, requirements=demands), rod)


def thread_oblique(given):
    """Thread a DLO that is soft for its weight, obliquely where that leaves more room."""
    stiffness, bent = given.between(0.002, 0.1), given.number % 4 == 3
    rod = Rod(1.0, 0.05, stiffness, 0.75 * stiffness, radius=2e-3, natural_curvature=tuple(
        given.rng.normal(size=2)) if bent else (0.0, 0.0))
    way = given.direction()
    way[2] = -abs(way[2]) if given.number % 3 else way[2]
    hole = CutOut(given.along((0, 0, 1), way), radius=given.rng.uniform(0.01, 0.04))
    inverse = InverseSimulator(DirectSimulator(rod, **_HOW[given.number % 3]))
    return of_plan(inverse.thread(hole), rod, 100 * PLANNED)


def thread_two(given):
    """Thread through two cut-outs."""
    inverse, rod = _inverse(given)
    way = given.direction()
    way[2] *= 0.5
    first = given.rng.normal(size=3)
    second = first + given.rng.uniform(0.15, 0.4) * way / np.linalg.norm(way)
    one, other = (CutOut(given.along(center, way)) for center in (first, second))
    return of_plan(inverse.plan(ThreadTwo(one, other, np.linspace(0, 0.8, 8))), rod)


def sequence(given):
    """Thread through three cut-outs."""
    inverse, rod = _inverse(given)
    first = _hole(given)
    centers, ways = [first.center], [first.normal]
    for _ in range(2):
        way = ways[-1] + 0.2 * given.rng.normal(size=3)
        ways.append(way / np.linalg.norm(way))
        centers.append(centers[-1] + 0.25 * ways[-1])
    holes = [CutOut(given.along(*pair)) for pair in zip(centers, ways, strict=True)]
    return of_plan(inverse.plan(ThreadSequence(holes, depths=np.linspace(0, 0.7, 8))), rod,
                   100 * PLANNED)


def insert(given):
    """Insert into a bore."""
    inverse, rod = _inverse(given)
    bore = CutOut(given.along(given.rng.normal(size=3), given.direction()), radius=1.2e-3)
    task = Insert(bore, np.linspace(0, 0.8, 8), 0.2 if given.number % 2 else None)
    return of_plan(inverse.plan(task), rod)


def approach(given):
    """Bring the free end before a cut-out."""
    inverse, rod = _inverse(given)
    hole = CutOut(given.along((0, 0, 1), (1, *given.rng.uniform(-0.3, 0.3, 2))), radius=0.05)
    plan = inverse.thread(hole, depths=np.linspace(0, 0.6, 5), max_misalignment=0)
    back = given.turned((-1.5, *given.rng.uniform((-0.3, 0.8), (0.3, 1.4))), (0, 0, 0))
    return of_plan(inverse.approach(hole, plan, back, standoff=0.05), rod, 10 * PLANNED)


def _contact(given):
    """Return an inverse simulator with an obstacle, and a contact on it."""
    normal = given.direction()
    normal[2] = abs(normal[2])
    along = np.cross(normal, given.direction())
    along /= np.linalg.norm(along)
    side = np.cross(normal, along)
    place = given.rng.normal(size=3)
    pose = Pose.from_rotation(place, np.column_stack([along, side, normal]))
    which = given.number % 4
    one = (Capsule(place - 0.05 * normal - 0.5 * side, place - 0.05 * normal + 0.5 * side, 0.05)
           if which == 3 else body(given, which, place, normal, along))
    if which == 2:
        one = Sphere(place - 0.08 * normal, 0.08)
    inverse, rod = _inverse(given, [one])
    return inverse, rod, pose


def hold(given):
    """Hold a contact, the forces given or the best of all."""
    inverse, rod, contact = _contact(given)
    s, kind = given.rng.uniform(0.3, 0.9), given.number % 5
    if kind < 3:
        forces = np.array([[0.05], [0.2], [1.0]])[kind]
        return of_plan(inverse.plan(HoldContact(contact, s, forces=forces, min_force=0.0)), rod)
    if kind == 3:
        return of_plan(inverse.plan(HoldContact(contact, s, 'least_force')), rod, 1e-4)
    plan = inverse.plan(HoldContact(contact, s))
    answer, scale = of_shape(plan.shapes[0], rod, 1e5, estimate=False), Scale.of(rod)
    answer.put('least energy', plan.shapes[0].elastic_energy, 2e-3 * scale.energy)
    return answer


def slide(given):
    """Slide along a contact."""
    inverse, rod, contact = _contact(given)
    lengths = np.linspace(0.5, 0.7, 3)
    mode = ('aligned', 'straight')[given.number % 2]
    return of_plan(inverse.plan(SlideContact(contact, lengths, forces=[0.1, 0.3, 1.0], mode=mode,
                                             condition='least_force', min_force=0.0)), rod,
                   100 * PLANNED)


def minimize(given):
    """Bring the DLO into a shape that penalties describe."""
    rod = planned_rod(given)
    start = given.turned((0, 0, 0), given.rng.normal(size=3) * 0.3)
    direct = DirectSimulator(rod, **_HOW[given.number % 2])
    hanging = direct.solve(start)
    target = hanging.at(1.0).position + 0.2 * given.rng.normal(size=3)
    near = GripperNear(start, 0.1)
    kind = given.number % 5
    penalties = ([PositionAt(1.0, target), DirectionAt(1.0, (1, 0, -0.3), 0.3), near],
                 [Through(target), near], [PositionAt(0.7, target), near],
                 [AwayFrom((Plane((0, 0, -0.2), (0, 0, 1)),), 0.05), PositionAt(1.0, target), near],
                 [KeepTangent(0.5, 1.0, (1, 0, 0)), BentAtMost(1.0), PositionAt(1.0, target),
                  near])[kind]
    plan = InverseSimulator(direct).plan(Minimize(penalties), start=start)
    return of_plan(plan, rod, 1e-3)


def trajectory(given):
    """Time a threading so that the DLO arrives calm."""
    inverse, rod = _inverse(given)
    hole = CutOut(given.along((0, 0, 1), (1, 0, 0.1 * given.number)), radius=0.05)
    plan = inverse.thread(hole, depths=np.linspace(0, 0.4, 4), max_misalignment=0)
    found = Trajectory(plan, tolerance=np.inf if given.number % 2 else None)
    answer = Answer()
    answer.say('status', found.status)
    answer.put('duration', found.duration, 1e-3 * found.duration)
    answer.put('mode_margin', found.mode_margin, 0.05)
    if found.motion is not None:
        answer.say('converged', found.motion.converged)
        answer.put('position_error', found.motion.position_error, 0.05 * found.tolerance)
        answer.put('swing', found.motion.swing, 0.2 * found.tolerance)
    return answer


def replayed(given):
    """Replay a threading, by its own simulator or a finer one."""
    inverse, rod = _inverse(given)
    hole = _hole(given, radius=0.05)
    plan = inverse.thread(hole, depths=np.linspace(0, 0.7, 6), max_misalignment=0)
    direct = inverse.simulator if given.number % 2 else DirectSimulator(
        rod, basis='local', n_elements=96)
    ball = Sphere(hole.center + 0.3 * given.direction(), 0.03)
    report = replay(direct, plan, obstacles=[ball])
    answer = Answer()
    for name in ('converged', 'safe'):
        answer.say(name, getattr(report, name))
    answer.say('not looked at', sorted(report.not_looked_at))
    for name in ('position_error', 'misalignment', 'deviation', 'clearance'):
        answer.put(name, getattr(report, name), 1e-5)
    answer.put('stability', report.stability, 1e-3)
    return answer


def robust(given):
    """Return by how much a threading misses where the DLO is another than assumed."""
    inverse, _ = _inverse(given)
    plan = inverse.thread(_hole(given, radius=0.05), depths=np.linspace(0, 0.6, 3),
                          max_misalignment=0)
    found = robustness(inverse.simulator, plan, Uncertainty(
        bending_stiffness=0.05, mass=0.02, length=2e-3, natural_curvature=0.02,
        gripper_position=1e-3, gripper_rotation=5e-3), samples=2)
    answer = Answer()
    answer.put('by_cause', found.by_cause, 1e-6)
    answer.put('sampled', found.sampled, 1e-5)
    answer.put('success', found.success, 1e-9)
    return answer
