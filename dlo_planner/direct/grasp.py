# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that is grasped somewhere along its length: two free ends.

From the gripper it is two DLOs, one to each end. The one to the beginning runs against the arc
length: its frame is (-t, n, -b), its strains are (torsion, -curvature about n, curvature about b).
The two do not push each other, and neither feels the other through the gripper; nothing else is
neglected. What else holds the DLO holds the part beyond the gripper: of several hands the one that
is nearest to the beginning is the gripper.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
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
from dlo_planner.model.holds import Hold, Holds, named
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import BACK, Rod, part_of_rod
from dlo_planner.model.supports import Surroundings
from dlo_planner.model.value import Value, brief, figures, put
from dlo_planner.progress import OnProgress, Progress, interrupted_by

_TURNED = np.diag([-1.0, 1.0, -1.0])  # of frames
_WAYS = -1, 1   # along the arc length, of the parts
_SAME = 1e-9    # of the length: places that are nearer are one
_ONE = 1e-7     # m, and of unit vectors: poses of a hand on two splines that are one


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
              holds: Iterable[Hold] = (), deadline: float | None = None) -> Shape:
        """Return the stable Shape, s from end to end; arguments as `DirectSimulator.solve`.

        `holds`: what else holds the DLO, beyond the gripper. One of the gripper's own place says
        what the gripper is called among them (`Hold.by`): `Shape.wrenches` have what it exerts, and
        `Shape.gripper_wrench` is 0 then.
        """
        before, backwards = self._before(initial), _both(gripper)[0]
        (beyond, name), = self._held([gripper], holds)
        with interrupted_by(Progress(deadline=deadline).check):
            back = self.parts[0].solve(backwards, before[0])
            on = self.parts[1].solve(gripper, before[1], holds=beyond)
        return _led(initial, self.joined(back, on, name))

    def track(self, grippers: Iterable[Pose], progress: OnProgress = None,
              initial: Shape | None = None, *, holds: Iterable[Any] = (),
              deadline: float | None = None) -> list[Shape]:
        """Return the shapes along a slow motion; arguments as `DirectSimulator.track`.

        `holds` as for `solve`.
        """
        grippers = poses(grippers)
        held = self._held(grippers, holds)
        steps = Progress(progress, deadline)
        before = self._before(initial)
        joined = []
        for gripper, (beyond, name) in zip(grippers, held, strict=True):
            with interrupted_by(steps.check):
                back = self.parts[0].track([_both(gripper)[0]], initial=before[0])[0]
                on = self.parts[1].track([gripper], initial=before[1], holds=beyond)[0]
            joined.append(_led(initial, self.joined(back, on, name)))
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
        each part. `holds` as for `solve`.
        """
        grippers = poses(grippers, 1)
        held = self._held(grippers, holds)
        beyond = [there for there, _ in held]
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
                                      integrator=integrator, holds=holding)
                        for part, way, shape, known, holding in zip(
                            self.parts, (backwards, forwards), before, velocities,
                            ((), beyond if any(beyond) else ()), strict=True))
        steps.done(len(forwards), len(forwards))
        return self._moved(back, on, held[0][1])

    def _moved(self, back: Motion, on: Motion, name: str | None) -> Motion:
        """Return the Motion of the whole DLO, as long as both its parts are known."""
        n = min(len(back), len(on))
        n = int(np.append(back.times[:n] != on.times[:n], True).argmax())
        ended = [(one.status, f'{name}: {one.message}') for one, name in (
            (back, 'the part before the gripper'), (on, 'the part beyond the gripper'))
            if one.status != 'complete']
        work, losses = (np.add(*(getattr(one, name)[:n] for one in (back, on)))
                        for name in ('work', 'losses'))
        shapes: list[Shape] = []
        for shape in map(partial(self.joined, name=name), back.shapes[:n], on.shapes[:n]):
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

    def _held(self, grippers: Sequence[Pose],
              holds: Iterable[Any]) -> list[tuple[Holds, str | None]]:
        """Return what holds the part beyond the gripper at each of its poses, and its own name."""
        return [self._beyond(gripper, there) for gripper, there in zip(
            grippers, held_by(None, holds, len(grippers), self.rod.length), strict=True)]

    def _beyond(self, gripper: Pose, holds: Holds) -> tuple[Holds, str | None]:
        beyond, name, near = list[Hold](), None, _SAME * self.rod.length
        for hold in holds:
            if hold.s is None:
                beyond.append(hold)
            elif hold.s > self.at + near:
                beyond.append(Hold(hold.pose, hold.grip, hold.s - self.at, hold.slip, by=hold.by))
            elif hold.s < self.at - near or hold.grip != 'clamped':
                raise InvalidTask(f'holds: {named(hold)} is {hold!r}: expected a hold beyond the '
                                  f'gripper, which holds the DLO at {self.at:g} m, or the clamped '
                                  'one of its own place')
            elif not np.allclose(hold.pose.matrix, gripper.matrix, rtol=0, atol=_ONE):
                raise InvalidTask(f'holds: {named(hold)} is {hold!r}: expected the pose of the '
                                  f'gripper, which is that hold, {gripper!r}')
            else:
                name = hold.by
        return tuple(beyond), name

    def taken(self, shape: Shape, holds: Iterable[Hold] = ()) -> Shape:
        """Return the Shape of the DLO once this simulator's gripper holds it, where it is.

        `shape` is of the same DLO, held in any way; `holds` as for `solve`. Each part is sought
        from its own piece of it.
        """
        frame, place = instance('shape', shape, Shape).frame_at(self.at)
        gripper = Pose.from_rotation(place, frame)
        (beyond, name), = self._held([gripper], holds)
        back, on = (part.solve(pose, piece_of(shape, self.at, way), holds=there)
                    for part, pose, way, there in zip(
                        self.parts, _both(gripper), _WAYS, ((), beyond), strict=True))
        return self.joined(back, on, name)

    def joined(self, back: Shape, on: Shape, name: str | None = None) -> Shape:
        """Return the Shape of both parts as one, s = 0 at the free end of `back`.

        `name`: what the gripper is called among the holds, if it is.
        """
        at = self.at
        wrench = back.gripper_wrench + on.gripper_wrench
        holds = [hold if hold.s is None else Hold(
            hold.pose, hold.grip, hold.s + at, hold.slip, by=hold.by) for hold in on.holds]
        wrenches = on.wrenches
        if name is not None:
            holds.insert(0, Hold(on.gripper, s=at, by=name))
            wrenches, wrench = np.vstack([wrench, wrenches]), np.zeros(6)
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
            gripper_wrench=wrench, holds=tuple(holds), wrenches=wrenches,
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


def piece_of(shape: Shape, at: float, way: int) -> Shape:
    """Return the piece of a Shape from `at` (m) to its end, or to its beginning (`way` = -1).

    It runs from there on, and is a first guess for what nothing else holds: it has no past.
    """
    frame, place = shape.frame_at(at)
    keep = (shape.s > at) if way > 0 else (shape.s < at)
    keep &= np.abs(shape.s - at) > _SAME * shape.s[-1]
    s, positions, frames = shape.s[keep], shape.positions[keep], shape.frames[keep]
    middles = 0.5 * (np.append(at, s[:-1]) + s) if way > 0 else 0.5 * (s + np.append(s[1:], at))
    strains = shape.element_strains[np.searchsorted(shape.s, middles) - 1]
    s, positions, frames, strains = (
        (np.append(0.0, s - at), np.vstack([place, positions]),
         np.concatenate([frame[None], frames]), strains) if way > 0 else
        (np.append(0.0, (at - s)[::-1]), np.vstack([place, positions[::-1]]),
         np.concatenate([frame[None], frames[::-1]]) @ _TURNED, strains[::-1] * BACK))
    return Shape(Pose.from_rotation(place, frames[0]), s, positions, frames, strains, shape.energy,
                 shape.elastic_energy, np.zeros(6), shape.residual, shape.stability, 0, False)


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
