# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that is grasped somewhere along its length: two free ends.

From the gripper it is two DLOs, one to each end. The one to the beginning runs against the arc
length: its frame is (-t, n, -b), its strains are (torsion, -curvature about n, curvature about b).
The two do not push each other, and neither feels the other through the gripper; nothing else is
neglected.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.boundary_motion import held_by, poses
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.self_passage import passed_between
from dlo_planner.direct.shape import Shape, State
from dlo_planner.direct.simulator import DirectSimulator, clamping, known_options
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, instance, number, shown
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import BACK, Rod, part_of_rod
from dlo_planner.model.supports import Surroundings
from dlo_planner.model.value import Value, brief, figures, put
from dlo_planner.progress import OnProgress, Progress, interrupted_by

_TURNED = np.diag([-1.0, 1.0, -1.0])  # of frames
_WAYS = -1, 1   # along the arc length, of the parts
_SAME = 1e-9    # of the length: places that are nearer are one


class GraspedInside(Value):
    """Predicts the shape of a DLO held at arc length `at`, with two free ends.

    Parameters
    ----------
    rod : Rod
        The whole rod.
    at : float
        Where the gripper holds it, m, 0 < at < length; x axis of the gripper = tangent there,
        towards growing s.
    options
        As for `DirectSimulator`, for each part.

    Attributes
    ----------
    whole : DirectSimulator
        The same DLO, held at its beginning.
    parts : tuple of DirectSimulator
        Of the part to the beginning, which runs against the arc length, and of that to the end.

    Raises
    ------
    InvalidTask, InvalidRod
        An argument makes no sense.
    """

    _PARTS = ('whole', 'at', 'parts')

    whole: DirectSimulator
    at: float
    parts: tuple[DirectSimulator, ...]

    def __init__(self, rod: Rod, at: float, **options: Any) -> None:
        instance('rod', rod, Rod)
        at = number('at', at, above=0, below=rod.length)
        self._hold(DirectSimulator(rod, **known_options(options)), at)

    def _hold(self, whole: DirectSimulator, at: float) -> None:
        put(self, whole=whole, at=at, parts=tuple(whole.part(at, way) for way in _WAYS))

    @classmethod
    def of(cls, simulator: DirectSimulator, at: float) -> Self:
        """Return the simulator of the same DLO held at `at`, m from its beginning, not there.

        Raises
        ------
        InvalidTask
            There is no such place inside the DLO, its gripper is a pinned one, or it has a
            permanent set.
        """
        made = object.__new__(cls)
        made._hold(clamping('simulator', simulator), at)
        return made

    def __repr__(self) -> str:
        return brief(self, f'at {self.at:.4g} m', figures(self.rod))

    @property
    def rod(self) -> Rod:
        """The whole Rod."""
        return self.whole.rod

    @property
    def surroundings(self) -> Surroundings:
        """The whole rod and all that acts on it."""
        return self.whole.surroundings

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Tuple of obstacles."""
        return self.whole.obstacles

    def elastic(self) -> Self:
        """Return a simulator of the same DLO that does not yield."""
        return self._each(DirectSimulator.elastic)

    def without_obstacles(self) -> Self:
        """Return a simulator of the same DLO with nothing in its way."""
        return self._each(DirectSimulator.without_obstacles)

    def with_friction(self, friction: float) -> Self:
        """Return a simulator of the same DLO, all its obstacles with a friction."""
        return self._each(lambda one: one.with_friction(friction))

    def left_by(self, shape: Shape) -> Self:
        """Return the simulator of the DLO as `shape` leaves each part: with its permanent set."""
        back, front = (part.left_by(one) for part, one in zip(
            self.parts, self.parts_of(shape), strict=True))
        return self._of(self.whole, (back, front))

    def with_rod(self, rod: Rod) -> Self:
        """Return a simulator of another Rod held at the same place, all else equal."""
        number('rod.length', instance('rod', rod, Rod).length, above=self.at)
        back, front = (part.with_rod(part_of_rod(rod, self.at, way))
                       for part, way in zip(self.parts, _WAYS, strict=True))
        return self._of(self.whole.with_rod(rod), (back, front))

    def _each(self, change: Callable[[DirectSimulator], DirectSimulator]) -> Self:
        return self._of(change(self.whole), tuple(map(change, self.parts)))

    def _of(self, whole: DirectSimulator, parts: tuple[DirectSimulator, ...]) -> Self:
        made = object.__new__(type(self))
        put(made, whole=whole, at=self.at, parts=parts)
        return made

    def solve(self, gripper: Pose, initial: Shape | None = None, *,
              deadline: float | None = None) -> Shape:
        """Return the stable Shape, s from end to end; arguments as `DirectSimulator.solve`."""
        before = self._before(initial)
        with interrupted_by(Progress(deadline=deadline).check):
            back, on = (part.solve(pose, shape) for part, pose, shape in
                        zip(self.parts, _both(gripper), before, strict=True))
        return _led(initial, self.joined(back, on))

    def track(self, grippers: Iterable[Pose], progress: OnProgress = None,
              initial: Shape | None = None, *, holds: Iterable[Any] = (),
              deadline: float | None = None) -> list[Shape]:
        """Return the shapes along a slow motion; arguments as `DirectSimulator.track`.

        Nothing else than the gripper may hold the DLO: `holds` has none.
        """
        grippers = poses(grippers)
        _held_by_none(holds, len(grippers), self.rod.length)
        steps = Progress(progress, deadline)
        before = self._before(initial)
        joined = []
        for gripper in grippers:
            with interrupted_by(steps.check):
                back, on = (part.track([pose], initial=shape)[0] for part, pose, shape in
                            zip(self.parts, _both(gripper), before, strict=True))
            joined.append(_led(initial, self.joined(back, on)))
            initial = joined[-1] if joined[-1].converged else initial
            before = tuple(shape if shape.converged else last
                           for shape, last in zip((back, on), before, strict=True))
            steps.done(len(joined), len(grippers))
        return joined

    def behind(self, grippers: Iterable[Pose], initial: Shape | None = None) -> list[Shape]:
        """Return the shapes of the part to the beginning alone; arguments as `track`."""
        return self.parts[0].track([_both(gripper)[0] for gripper in poses(grippers)],
                                   initial=self._before(initial)[0])

    def simulate(self, grippers: Iterable[Pose], dt: float,
                 initial: Shape | Motion | None = None, *, holds: Iterable[Any] = (),
                 velocity: ArrayLike | None = None, tolerance: float | None = None,
                 integrator: str = 'generalized_alpha', progress: OnProgress = None,
                 deadline: float | None = None) -> Motion:
        """Return the Motion of both parts; arguments as `DirectSimulator.simulate`.

        `velocity` is (N + 1, 3) of the nodes of `initial`, no function. Where one part cannot go
        on, the motion ends for both, and its message says which part it is. `tolerance` is for
        each part. Nothing else than the gripper may hold the DLO: `holds` has none.
        """
        grippers = poses(grippers, 1)
        _held_by_none(holds, len(grippers), self.rod.length)
        steps, (backwards, forwards) = Progress(progress, deadline), _all_of(grippers)
        before: list[Shape | Motion | None] = [None, None]
        velocities: list[Floats | None] = [None, None]
        if isinstance(initial, Motion):
            if not len(initial):
                raise InvalidTask('initial: expected a Motion with instants, it has none')
            velocity = initial.velocities[-1] if velocity is None else velocity
            initial = initial.shapes[-1]
        if initial is not None:
            before = [*self._before(initial)]
        if velocity is not None:
            if initial is None:
                raise InvalidTask('initial = None: expected the Shape whose nodes have these '
                                  'velocities')
            known = array('velocity', velocity, (initial.s.size, 3))
            gripped = self.parts_of(initial)[0].s.size - 1
            velocities = [known[gripped::-1], known[gripped:]]
        with interrupted_by(steps.check):
            back, on = (part.simulate(way, dt, shape, velocity=known, tolerance=tolerance,
                                      integrator=integrator)
                        for part, way, shape, known in zip(
                            self.parts, (backwards, forwards), before, velocities, strict=True))
        steps.done(len(forwards), len(forwards))
        return self._moved(back, on)

    def _moved(self, back: Motion, on: Motion) -> Motion:
        """Return the Motion of the whole DLO, as long as both its parts are known."""
        n = min(len(back), len(on))
        n = int(np.append(back.times[:n] != on.times[:n], True).argmax())
        ended = [(one.status, f'{name}: {one.message}') for one, name in (
            (back, 'the part before the gripper'), (on, 'the part beyond the gripper'))
            if one.status != 'complete']
        work, losses = (np.add(*(getattr(one, name)[:n] for one in (back, on)))
                        for name in ('work', 'losses'))
        shapes: list[Shape] = []
        for shape in map(self.joined, back.shapes[:n], on.shapes[:n]):
            led = _led(shapes[-1], shape) if shapes else shape
            passed = bool(shapes) and shapes[-1].passed_itself is True  # since it began
            shapes.append(replace(led, passed_itself=True) if passed else led)
        if not ended and shapes[-1].passed_itself is True:
            ended = [('self-passage', 'on the way one part passes through the other')]
        return Motion(
            on.times[:n], tuple(shapes), np.concatenate(
                [back.velocities[:n, :0:-1], on.velocities[:n]], axis=1),
            back.kinetic_energy[:n] + on.kinetic_energy[:n],
            back.potential_energy[:n] + on.potential_energy[:n], work, losses, on.tolerance,
            ended[0][0] if ended else 'complete', '; '.join(said for _, said in ended),
            partial(_larger_errors, back, on, n))

    def parts_of(self, initial: Shape) -> tuple[Shape, ...]:
        """Return the Shapes of both parts of a Shape to start from.

        Raises
        ------
        InvalidTask
            It is of a DLO that is held elsewhere.
        """
        at = grasped_at(instance('initial', initial, Shape))
        if initial.parts is None or at is None or abs(at - self.at) > _SAME * self.rod.length:
            raise InvalidTask(f'initial = {shown(initial)}: expected a Shape of a DLO grasped '
                              f'inside, at {self.at:g} m, it is held at {at or 0.0:g} m')
        return initial.parts

    def _before(self, initial: Shape | None) -> tuple[Shape | None, ...]:
        return (None, None) if initial is None else self.parts_of(initial)

    def joined(self, back: Shape, on: Shape) -> Shape:
        """Return the Shape of both parts as one, s = 0 at the free end of `back`."""
        at = self.at
        contacts = [replace(contact, s=at - contact.s) for contact in reversed(back.contacts)]
        contacts += [replace(contact, s=at + contact.s) for contact in on.contacts]
        s = np.concatenate([at - back.s[:0:-1], at + on.s])
        s[0], s[-1] = 0.0, self.rod.length
        passed = (back.passed_itself, on.passed_itself)
        return replace(
            on, s=s, positions=np.vstack([back.positions[:0:-1], on.positions]),
            frames=np.concatenate([back.frames[:0:-1] @ _TURNED, on.frames]),
            element_strains=np.vstack([back.element_strains[::-1] * BACK, on.element_strains]),
            energy=back.energy + on.energy,
            elastic_energy=back.elastic_energy + on.elastic_energy,
            gripper_wrench=back.gripper_wrench + on.gripper_wrench,
            residual=max(back.residual, on.residual), stability=min(back.stability, on.stability),
            iterations=max(back.iterations, on.iterations),
            converged=back.converged and on.converged, jumped=back.jumped or on.jumped,
            contacts=tuple(contacts), violation=max(back.violation, on.violation),
            dissipated=back.dissipated + on.dissipated, parts=(back, on),
            passed_itself=True in passed or (False if passed == (False, False) else np.nan),
            state=State(mesh=self._mesh(s), estimate=partial(_larger_estimate, back, on)))

    def _mesh(self, s: Floats) -> Discretization:
        """Return the Discretization of the whole DLO on nodes s; that of the last ones is kept."""
        known: Discretization | None = self.__dict__.get('_known')
        if known is None or not np.array_equal(known.s, s):
            known = Discretization(self.surroundings, s.copy(), 'local', 0)
            put(self, _known=known)
        return known


# What predicts shapes and motions of a DLO, wherever its gripper holds it.
Simulator: TypeAlias = DirectSimulator | GraspedInside


def held_at(simulator: DirectSimulator, at: float | None) -> Simulator:
    """Return the simulator of the same DLO held at `at`, m from its beginning; None, 0: there."""
    return GraspedInside.of(simulator, at) if at else simulator


def held_as(name: str, simulator: object, shape: Shape) -> Simulator:
    """Return the simulator of a DLO whose gripper holds it where it does in a Shape.

    Raises
    ------
    InvalidTask
        It is none, of a pinned gripper, or holds it inside where the Shape is held elsewhere.
    """
    at = grasped_at(shape)
    if isinstance(simulator, GraspedInside):
        if at is None or abs(at - simulator.at) > _SAME * simulator.rod.length:
            raise InvalidTask(f'{name} holds the DLO at {simulator.at:g} m: expected '
                              f'{at or 0.0:g} m, where the gripper of the plan does')
        return simulator
    return held_at(clamping(name, simulator), at)


def grasped_at(shape: Shape) -> float | None:
    """Return the arc length (m) at which a Shape is grasped inside; None: held at its beginning."""
    return None if shape.parts is None else float(shape.parts[0].s[-1])


def _held_by_none(holds: Iterable[Any], count: int, length: float) -> None:
    """Raise InvalidTask where something holds a DLO of a length (m) beside the gripper inside."""
    for there in held_by(None, holds, count, length):
        if there:
            raise InvalidTask(f'holds = {shown(there)}: expected none, the gripper alone holds a '
                              'DLO that is grasped inside')


def _both(gripper: Pose) -> tuple[Pose, Pose]:
    instance('gripper', gripper, Pose)
    return Pose.from_rotation(gripper.position, gripper.rotation @ _TURNED), gripper


def _all_of(grippers: Iterable[Pose]) -> tuple[list[Pose], list[Pose]]:
    """Return the poses of the gripper for the part before it, and for that beyond it."""
    both = [_both(gripper) for gripper in poses(grippers, 1)]
    return [back for back, _ in both], [on for _, on in both]


def _led(previous: Shape | None, shape: Shape) -> Shape:
    """Return a joined Shape that knows whether one part passed through the other on the way there.

    Of itself each part has looked.
    """
    passed = False if previous is None else passed_between(previous, shape, shape.jumped)
    if passed is False or shape.passed_itself is True:
        return shape
    return replace(shape, passed_itself=passed)


def _larger_errors(back: Motion, on: Motion, n: int, most: float) -> Floats:
    """Return the larger error estimates (n,), m, of two Motions; all where `most` is inf."""
    both: Floats = np.maximum(*(
        (one.error_estimate if most < np.inf else one.estimate_error())[:n] for one in (back, on)))
    return both


def _larger_estimate(back: Shape, on: Shape) -> float:
    return max(back.error_estimate, on.error_estimate)
