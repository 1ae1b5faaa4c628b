# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The direct simulator: from gripper poses to shapes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from inspect import signature
from typing import Any, Self

from numpy.typing import ArrayLike

from dlo_planner.direct.accuracy import (
    default_accuracy,
    fine_enough,
    first_mesh,
    judged,
    mesh_to_begin_with,
)
from dlo_planner.direct.boundary_motion import held_by, moving_grips, poses
from dlo_planner.direct.continuation import Equilibrium, follow, followed_within
from dlo_planner.direct.discretization import Discretization, Memory, even_mesh
from dlo_planner.direct.dynamics import (
    InitialConditions,
    IntegrationOptions,
    Velocity,
    at_full_length,
    colliding_mesh,
    fastest_of,
    first_shape,
    motion_tolerance,
    moving_mesh,
    nodes_velocity,
    refuse_motion,
    simulate,
)
from dlo_planner.direct.grips import Grips
from dlo_planner.direct.integrator import INTEGRATORS
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.search import METHODS, STRAINS
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import StepInputs, StepSolver, step
from dlo_planner.direct.stepper import Stepper
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.basis import BASES, converging
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, integer, items, number, shown
from dlo_planner.model.holds import Hold, Holds, have_rings, holds_of, named, places_of
from dlo_planner.model.obstacles import OBSTACLES, Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.supports import STANDARD_GRAVITY, AnyLoad, Surroundings
from dlo_planner.model.value import Value, brief, figures, put, same
from dlo_planner.model.varying import stepwise
from dlo_planner.progress import OnProgress, Progress, interrupted_by

_FARTHEST = 10  # of the length: from where what is held may be brought


class DirectSimulator(Value):
    """Predicts the static shape of a DLO for a gripper pose, by minimizing its potential.

    A DLO that yields remembers: the permanent set goes from a shape to the next by `initial`, and
    through `track` and `simulate`. `with_set` and `reset` return simulators that start from it.
    A simulator does not change; two of the same rod, surroundings and options are equal.

    Parameters
    ----------
    rod : Rod
        The DLO that is held.
    n_elements : int, optional
        N_L, elements (64 where only n_terms is given), of equal length between the places where
        something jumps.
    n_terms : int, optional
        N_c, terms of the Ritz series per strain component (10 where only n_elements is given); N_L
        of them span all that the elements can do, more are the same as N_L.
    basis : str, optional
        'chebyshev' (default), 'fourier', 'fourier_polynomial' (with polynomials to degree 4 beside
        it; it replaces 'fourier' where an accuracy is asked for, which the plain series hardly ever
        reaches), or 'local' (one unknown strain per element).
    method : str, optional
        'newton' (default), or the paper's 'dfp' and 'downhill_simplex', for study: without
        obstacles, held far ends, dead moments and pinned grippers; the last one is slow.
    strains : str, optional
        What the series describe: 'components' (torsion, curvature about n, about b) or 'paper'
        (q_d, q_kappa, q_tau), for study, with 'dfp' or 'downhill_simplex' only.
    accuracy : float, optional
        In m; picks mesh and terms instead of n_elements and n_terms. The basis is then 'local'
        unless one is named. Without any of the three it is 1e-3 of the length, less for a DLO
        that its loads F bend near the gripper: without obstacles (27 EI / F L^2)^(2/3) of that,
        at least 1.5e-4 of the length; 64 elements with 10 terms are kept wherever they do. The
        paper's methods keep them anyway. Of what has fallen among obstacles it is kept where the
        DLO has landed; only `error_estimate` counts how far elsewhere that may have been.
    gravity : array_like, shape (3,), optional
        Gravity in m/s^2, any direction, may be zero.
    load : array_like or callable, optional
        Further force per length, N/m, world axes: (3,), or a callable of s (m).
    obstacles : Iterable, optional
        Plane, Sphere, Capsule, Cylinder, Box, Ellipsoid, Sheet, Mesh or Hull, in any number.
    point_loads : Iterable, optional
        PointLoads, dead forces and moments at points.
    grip : str, optional
        'clamped' (default), or 'pinned': the gripper holds the position of the DLO's beginning,
        which may turn like in a ball joint. A shape's gripper and first frame then have the
        rotation of the equilibrium; of a given pose the rotation is only where the search begins,
        without a shape before.
    self_contact : bool, optional
        Whether strands of the DLO keep each other off (`Shape.self_contacts`): of a round, elastic
        DLO with a radius, in clamped grips. In motions they are springs.
    self_friction : float, optional
        Coefficient of friction between strands, with `self_contact`; 0 by default. It counts from
        the shape before, so a first shape has none.

    Attributes
    ----------
    surroundings : Surroundings
        The rod and all that acts on it.
    accuracy : float or None
        In m. If None, the mesh is fixed.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    _PARTS = ('surroundings', 'method', 'strains', 'accuracy', 'basis', '_asked', '_fine',
             '_history', '_discretization')

    surroundings: Surroundings
    method: str
    strains: str
    basis: str
    accuracy: float | None
    _asked: bool  # whether the accuracy was
    _fine: str
    _history: Memory | None
    _discretization: Discretization

    def __init__(self, rod: Rod, *, n_elements: int | None = None, n_terms: int | None = None,
                 basis: str | None = None, method: str = 'newton', strains: str = 'components',
                 accuracy: float | None = None, gravity: ArrayLike = STANDARD_GRAVITY,
                 load: ArrayLike | Callable[[float], ArrayLike] | None = None,
                 obstacles: Iterable[Obstacle] = (), point_loads: Iterable[AnyLoad] = (),
                 grip: str = 'clamped', self_contact: bool = False,
                 self_friction: float = 0.0) -> None:
        given: Any = {'gravity': gravity, 'load': load, 'obstacles': obstacles,
                      'point_loads': point_loads}  # judged there
        around = Surroundings(rod, grip=grip, self_contact=self_contact,
                              self_friction=self_friction, **given)
        fixed = n_elements is not None or n_terms is not None
        put(self, surroundings=around, _history=None, method=choice('method', method, METHODS),
            strains=choice('strains', strains, STRAINS),
            basis='chebyshev' if basis is None else choice('basis', basis, BASES))
        put(self, _fine='local' if basis is None else converging(self.basis),
            _asked=accuracy is not None)
        self._judge_method()
        if accuracy is not None:
            if fixed:
                raise InvalidTask(
                    f'accuracy = {shown(accuracy)} picks n_elements and n_terms: expected it or '
                    'them, not both')
            if method != 'newton':
                raise InvalidTask(f'method = {method!r}: expected \'newton\' with an accuracy')
            put(self, accuracy=number('accuracy', accuracy, minimum=1e-9 * rod.length),
                basis=self._fine, _discretization=first_mesh(around, self._fine))
            return
        n_elements = integer('n_elements', 64 if n_elements is None else n_elements,
                             minimum=2, maximum=100_000)
        n_terms = integer('n_terms', min(10, n_elements) if n_terms is None else n_terms,
                          minimum=1, maximum=200)
        begin = Discretization(around, even_mesh(rod.length, n_elements, around.breaks), self.basis,
                               n_terms)
        put(self, accuracy=None if fixed or method != 'newton' else default_accuracy(begin),
            _discretization=begin)

    def _judge_method(self) -> None:
        around = self.surroundings
        if self.strains == 'paper' and (self.method == 'newton' or self.basis == 'local'):
            raise InvalidTask(f'strains = {self.strains!r}: expected a series as basis and '
                              "'dfp' or 'downhill_simplex' as method, got "
                              f'{self.basis!r}, {self.method!r}')
        if self.method != 'newton':
            for present, what in ((around.obstacles, 'obstacles'),
                                  (around.pinned, 'a pinned gripper'),
                                  (around.has_moments, 'dead moments')):
                if present:
                    raise InvalidTask(f'method = {self.method!r}: expected \'newton\' with {what}')

    def __repr__(self) -> str:
        mesh = self._discretization
        how = (f'{mesh.s.size - 1} elements' if self.accuracy is None
               else f'accuracy {self.accuracy:.2g} m')
        terms = ('' if self.accuracy is not None or self.basis == 'local'
                 else f'{mesh.n_terms} terms')
        return brief(self, how, terms, self.basis, '' if self.method == 'newton' else self.method,
                     f'{len(self.obstacles)} obstacles' if self.obstacles else '',
                     'set' if self._history is not None else '', figures(self.rod))

    @property
    def rod(self) -> Rod:
        """The Rod."""
        return self.surroundings.rod

    @property
    def mesh(self) -> Discretization:
        """The Discretization that shapes are computed on, at first."""
        return self._discretization

    @property
    def history(self) -> Memory | None:
        """The permanent set that it starts from, see `with_set`; None: none."""
        return self._history

    @property
    def gravity(self) -> Floats:
        """(3,) m/s^2."""
        return self.surroundings.gravity

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Tuple of obstacles."""
        return self.surroundings.obstacles

    def with_set(self, shape: Shape) -> Self:
        """Return a simulator of the DLO as `shape` leaves it, with its permanent set.

        Raises
        ------
        InvalidTask
            Not a Shape of this DLO, or of one that is grasped inside.
        """
        instance('shape', shape, Shape)
        self._check(shape.gripper, shape)
        past = shape.state.history
        if past is None or past.of is not None and not same(past.of.rod, self.rod):
            raise InvalidTask(f'shape = {shown(shape)}: expected one of this simulator\'s rod, '
                              'held at its beginning, which knows its permanent set')
        return self._changed(_history=past.permanent_part())

    def left_by(self, shape: Shape) -> Self:
        """Return the simulator of the DLO as `shape` leaves it: `with_set`, if it has any."""
        instance('initial', shape, Shape)
        self._check(shape.gripper, shape)
        past = shape.state.history
        return self if past is None or not past.has_set else self.with_set(shape)

    def reset(self) -> Self:
        """Return a simulator of the DLO as it was made, without any permanent set."""
        return self._changed(_history=None)

    def _changed(self, **contents: object) -> Self:
        other = object.__new__(type(self))
        put(other, **self.__dict__)
        put(other, **contents)
        return other

    def elastic(self) -> Self:
        """Return a simulator of the same DLO, set as it is, that does not yield any further."""
        rod = self.rod
        if not rod.yields:
            return self
        free: dict[str, Any] = {'yield_curvature': None, 'yield_torsion': None}
        if self._history is not None:
            mesh = self._discretization
            if self.accuracy is not None:
                mesh = Discretization(self.surroundings, self._history.s, 'local', 0)
            strains = mesh.stress_free(self._history)
            free |= {'natural_curvature': stepwise(mesh.s, strains[:, 1:]),
                     'natural_twist': stepwise(mesh.s, strains[:, 0])}
        return self._with(replace(self.surroundings, rod=replace(rod, **free)), None)

    def without_obstacles(self) -> Self:
        """Return a simulator of the same DLO, set as it is, with nothing in its way."""
        if not self.obstacles:
            return self
        return self._with(replace(self.surroundings, obstacles=()), self._history)

    def with_obstacles(self, obstacles: Iterable[Obstacle]) -> Self:
        """Return a simulator of the same DLO, set as it is, among other obstacles."""
        around = items('obstacles', obstacles, OBSTACLES)
        return self._with(replace(self.surroundings, obstacles=around), self._history)

    def with_friction(self, friction: float) -> Self:
        """Return a simulator of the same DLO, set as it is, all its obstacles with a friction."""
        obstacles = tuple(replace(one, friction=friction) for one in self.obstacles)
        return self._with(replace(self.surroundings, obstacles=obstacles), self._history)

    def with_rod(self, rod: Rod) -> Self:
        """Return a simulator of another Rod (as long or not), all else equal, without a set.

        PointLoads in the last twentieth of this one that would be beyond the other's end, or are at
        this one's, are at the other's; any other has to be on the other Rod.
        """
        return self._with(self.surroundings.of_rod(rod), None)

    def part(self, at: float, direction: int) -> Self:
        """Return a simulator of the part from `at` to one end, held at `at`, all else equal.

        It knows nothing of the other part, and finds its own mesh: as many elements, or as exact.

        Parameters
        ----------
        at : float
            Where it is held, m from the DLO's beginning, 0 < at < length.
        direction : int
            1 to the end, -1 to the beginning: then against the arc length.

        Raises
        ------
        InvalidTask
            An argument makes no sense, or the DLO has a permanent set, which stays on its mesh.
        """
        at = number('at', at, above=0, below=self.rod.length)
        if not integer('direction', direction, minimum=-1, maximum=1):
            raise InvalidTask(f'direction = {shown(direction)}: expected 1, to the end, or -1, to '
                              'the beginning')
        around = self.surroundings.part(at, direction)
        if self._history is not None:  # it stays on its mesh
            raise InvalidTask('simulator: expected one without a permanent set (`reset`) where a '
                              f'part of its DLO is held, at {at:g} m')
        first = self._discretization
        mesh = Discretization(around, even_mesh(around.rod.length, first.s.size - 1, around.breaks),
                              first.basis, first.n_terms)
        if self.accuracy is None:
            return self._changed(surroundings=around, _discretization=mesh)
        if self._asked:
            return self._changed(surroundings=around,
                                 _discretization=first_mesh(around, self._fine))
        return self._changed(surroundings=around, _discretization=mesh,
                             accuracy=default_accuracy(mesh))

    def _with(self, surroundings: Surroundings, history: Memory | None) -> Self:
        share = surroundings.rod.length / self.rod.length
        return self._changed(
            surroundings=surroundings, _history=history,
            accuracy=None if self.accuracy is None else self.accuracy * share,
            _discretization=self._discretization.within(surroundings))

    def solve(self, gripper: Pose, initial: Shape | None = None, *,
              far_end: Hold | Pose | ArrayLike | None = None, holds: Iterable[Hold] = (),
              deadline: float | None = None) -> Shape:
        """Return the stable Shape that the DLO falls into.

        Parameters
        ----------
        gripper : Pose
            Pose of the gripper; x axis = tangent of the DLO where it leaves.
        initial : Shape, optional
            Shape to start from: the gripper goes straight from its pose to the new one, around no
            obstacle, and a permanent set is kept. What touches goes in parts of at most 0.05 of the
            length, shorter where it may fall. If None, the search starts from the stress-free
            shape, set down at the pose, wherever obstacles are.
        far_end : FarEnd or Pose or array_like, optional
            Pose that clamps the far end, position (3,) that pins it, or FarEnd. If None, the far
            end is free, but for one of `holds`.
        holds : Iterable, optional
            Holds of any places, in any order. The DLO is brought into all of them together, from
            the shape before or the stress-free one. Where one is inside, the elements are 'local'.
        deadline : float, optional
            Seconds of computing after which DeadlineExceeded is raised. If None, no limit.

        Returns
        -------
        Shape
            `converged` is False if no equilibrium was found; that raises no exception.
        """
        if deadline is not None:
            with interrupted_by(Progress(deadline=deadline).check):
                return self.solve(gripper, initial, far_end=far_end, holds=holds)
        held: Holds = ()
        if far_end is not None or not isinstance(holds, tuple) or holds:
            held = holds_of(far_end, holds, self.surroundings.rod.length)
        self._check(gripper, initial, held)
        try:
            take = self._taken_by(held, None if initial is None else gripper)
            if initial is None or not (made_by(self, initial) or initial.state.kept):
                shape = take(gripper, initial, held)
            else:
                shape = follow(take, initial, gripper, held, True, counted=self._asked)
                if shape.contacts and self.accuracy is not None and self._asked:
                    shape = followed_within(self.accuracy, take, initial, shape,
                                            Grips(gripper, held))
            if self.accuracy is not None and self._asked:  # the default is not promised
                return judged(shape, self.accuracy)
            return shape
        except SystemError as error:  # a signal that had to wait for the end of a kernel
            raise _signal(error) from None

    def track(self, grippers: Iterable[Pose], progress: OnProgress = None,
              initial: Shape | None = None, *, far_ends: Iterable[Any] | None = None,
              holds: Iterable[Any] = (), deadline: float | None = None) -> list[Shape]:
        """Return the shapes along a slow motion, each the continuation of the one before.

        Between poses the motion is taken as straight (position linear, rotation about one axis).
        Where the shape cannot follow continuously, it falls into the next minimum, and
        `Shape.jumped` says so. A shape that is not converged is followed by the continuation of
        the one before it, or, if it is `nearly`, by its own; `Shape.status` tells which.

        Parameters
        ----------
        grippers : iterable of Pose
            Poses of the gripper, in their order.
        progress : callable, optional
            Called as progress(done, total) after each shape.
        initial : Shape, optional
            Shape before the first pose. If None, the natural shape.
        far_ends : Iterable, optional
            One per gripper pose, as in `solve`. If None, the far end is free.
        holds : Iterable, optional
            Holds, which rest; or, one per gripper pose, those that hold there.
        deadline : float, optional
            Seconds of computing after which DeadlineExceeded is raised. If None, no limit.

        Raises
        ------
        InvalidTask
            An argument makes no sense; the message names it.
        """
        grippers = poses(grippers)
        steps = Progress(progress, deadline)
        held = held_by(far_ends, holds, len(grippers), self.rod.length)
        shapes = []
        with interrupted_by(steps.check):
            for gripper, there in zip(grippers, held, strict=True):
                self._check(gripper, initial, there)
                before = self._settled(initial)
                if before is None:
                    shape = self._equilibrium(gripper, initial, there)
                else:
                    take = self._taken_by(there, gripper)
                    shape = follow(take, before, gripper, there, counted=self._asked)
                    if self.accuracy is not None and self._asked:
                        if shape.contacts:
                            shape = followed_within(self.accuracy, take, before, shape,
                                                    Grips(gripper, there))
                        shape = judged(shape, self.accuracy)
                shapes.append(shape)
                if shape.converged or shape.nearly:  # a failure is reported, not carried on
                    initial = shape
                steps.done(len(shapes), len(grippers))
        return shapes

    def simulate(self, grippers: Iterable[Pose], dt: float,
                 initial: Shape | Motion | None = None, *, far_ends: Iterable[Any] | None = None,
                 holds: Iterable[Any] = (), velocity: Velocity | None = None,
                 tolerance: float | None = None, integrator: str = 'generalized_alpha',
                 progress: OnProgress = None, deadline: float | None = None) -> Motion:
        """Return the Motion of the DLO under moving grips, with inertia and damping.

        Between the instants the grips move along cubic splines with continuous accelerations
        (`direct.boundary_motion`), from rest at time 0 unless the DLO moves there. Steps are
        halved where their local error, a gain of energy or Newton's method asks for it.

        Where the motion cannot go on it ends: `Motion.converged` is False then, and `status` and
        `message` say why, and when.

        Parameters
        ----------
        grippers : iterable of Pose
            The n poses at the times 0, dt, 2 dt, ...: a prescribed motion.
        dt : float
            Time step between two instants that are wanted, s; no step is longer.
        initial : Shape or Motion, optional
            Shape at time 0, in equilibrium or not, held by its grips where they are then; or a
            Motion, whose last shape and velocities are continued. If None, the static shape.
        far_ends : Iterable, optional
            One per gripper pose, as in `solve`, all of the same grip. If None, it is free.
        holds : Iterable, optional
            As in `track`, the same places and grips from the beginning to the end.
        velocity : array_like or callable, optional
            At time 0, m/s, world axes: (N + 1, 3) of the nodes of `initial`, or a callable of s (m)
            that returns (3,); the nearest velocities that grips and length allow are taken. If
            None, at rest, or that of a Motion.
        tolerance : float, optional
            Tolerance in m. A step may add 1/600 of it to the error; if infinite, no step is halved
            for its error. If None, 1e-3 of the length. `Motion.error_estimate` tells the error.
        integrator : str, optional
            'generalized_alpha' (second order) or 'paper' (Eq. 8 to 10: first order, damps, in fixed
            steps of dt), see `direct.integrator`.
        progress : callable, optional
            Called as progress(done, total) after each instant.
        deadline : float, optional
            Seconds of computing after which DeadlineExceeded is raised. If None, no limit.

        Raises
        ------
        InvalidTask
            An argument makes no sense; the message names it.
        """
        return motion_by(Stepper, self, grippers, dt, Progress(progress, deadline), initial,
                         far_ends, velocity, tolerance, integrator, holds)

    def discretization(self, gripper: Pose, shape: Shape | None) -> Discretization:
        """Return the Discretization that this simulator uses at a gripper's pose.

        Parameters
        ----------
        gripper : Pose
        shape : Shape or None
            Shape found there, None if there is none yet. With `accuracy`, its mesh is returned if
            it is fine enough, else one that is.
        """
        self._check(gripper, shape)
        if self.accuracy is None:
            return self._discretization.with_nodes(() if shape is None else places_of(shape.holds))
        if (shape is not None and made_by(self, shape)
                and shape.state.made_on.basis in (self.basis, self._fine)
                and fine_enough(shape, self.accuracy)):
            return shape.state.made_on
        return self._equilibrium(gripper, shape, ()).state.made_on

    def mesh_after(self, shape: Shape | None) -> Discretization:
        """Return the Discretization on which what follows a Shape, or None, is sought first."""
        return mesh_to_begin_with(self._discretization, self._fine, self.accuracy,
                                  instance('shape', shape, Shape, optional=True), self._history)

    def _equilibrium(self, gripper: Pose, initial: Shape | None, holds: Holds) -> Shape:
        """Return the Shape of a step as it is."""
        shape = self._taken_by(holds)(gripper, initial, holds)
        if self.accuracy is not None and self._asked:
            return judged(shape, self.accuracy)
        return shape

    def _taken_by(self, holds: Holds, gripper: Pose | None = None) -> Equilibrium:
        """Return what takes steps of the DLO in these holds, or parts of one to a gripper."""
        goal = None
        if gripper is not None and not self.surroundings.pinned:  # (the DLO turns what pins it)
            goal = Grips(gripper, holds)
        solver = StepSolver(self._discretization, self._fine, self.accuracy, self._history,
                            self.method, self.strains, goal, self._asked)
        if holds and have_rings(holds):
            from dlo_planner.direct.sliding import slid  # noqa: PLC0415  (no other DLO needs it)
            return partial(slid, solver)
        return solver.take

    def _settled(self, shape: Shape | None) -> Shape | None:
        """Return what a Shape or None, made anywhere, becomes here in its grippers; or None."""
        if shape is None or made_by(self, shape):
            return shape
        self._check(shape.gripper, shape, shape.holds)
        found = self._equilibrium(shape.gripper, shape, shape.holds)
        return found if found.converged else None

    def _check(self, gripper: Pose, initial: Shape | None,
               holds: Holds = ()) -> None:
        instance('gripper', gripper, Pose)
        instance('initial', initial, Shape, optional=True)
        if initial is not None and initial.parts is not None:
            raise InvalidTask(f'initial = {initial!r}: expected one of a DLO that is held at its '
                              'beginning, not grasped inside')
        if holds and self.method != 'newton':
            raise InvalidTask(f'method = {self.method!r}: expected \'newton\' with a far end')
        if holds:  # they, and the gripper, go there step by step
            for hold in holds:
                self._near(gripper, 'far_end' if hold.s is None else named(hold), hold.pose)
            if initial is not None:
                self._near(gripper, 'initial', initial.gripper)
        if initial is not None and abs(initial.s[-1] - self.rod.length) > 1e-9 * self.rod.length:
            raise InvalidTask(f'initial has length {initial.s[-1]:g} m: '
                              f'expected the rod\'s {self.rod.length:g} m')

    def _near(self, gripper: Pose, name: str, pose: Pose) -> None:
        farthest = _FARTHEST * self.rod.length
        away = max(map(abs, (pose.position - gripper.position).tolist()))  # quicker than by numpy
        if away > farthest:
            raise InvalidTask(f'{name} = {pose!r}: expected within {farthest:g} m of the gripper, '
                              f'is {away:.3g} m off')

    def _beginning(self, gripper: Pose, holds: Holds, initial: Shape | None,
                   goes_on: bool = False) -> tuple[Shape, Discretization]:
        """Return the Shape at time 0 of a motion and the Discretization for the rest of it.

        `goes_on`: whether `initial` is where another motion ended.
        """
        mesh = self._discretization.with_nodes(places_of(holds))
        known = initial
        if goes_on and initial is not None and made_by(self, initial):
            # on its own mesh: where another one is pressed in, what bears would be thrown off
            mesh = initial.state.made_on.with_nodes(places_of(holds))
            return first_shape(mesh, gripper, holds, initial, self._history, True), mesh
        if self.accuracy is not None:
            known = self._equilibrium(gripper, initial, holds)
            if known.state.mesh is not mesh or mesh.s.size <= _ENOUGH:
                mesh = moving_mesh(known.state.made_on)
            if initial is None or not initial.contacts:  # what bears stays on its own mesh
                mesh = colliding_mesh(mesh)
        if initial is not None:
            return first_shape(mesh, gripper, holds, initial, self._history), mesh
        start = (self._equilibrium(gripper, None, holds) if self.accuracy is None
                 else step(mesh, gripper, known, StepInputs(self._history, holds, self.method)))
        return at_full_length(start, holds, self._history), mesh


def made_by(simulator: DirectSimulator, shape: Shape) -> bool:
    """Whether a Shape is of a simulator's DLO, with all that acts on it there."""
    known = shape.state.mesh
    return known is not None and same(known.surroundings, simulator.surroundings)


_ENOUGH = 64  # nodes of a mesh that a motion is begun with as it is


def motion_by(make: Callable[..., Stepper], simulator: DirectSimulator, grippers: Iterable[Pose],
              dt: float, steps: Progress, initial: Shape | Motion | None = None,
              far_ends: Iterable[Any] | None = None, velocity: Velocity | None = None,
              tolerance: float | None = None, integrator: str = 'generalized_alpha',
              holds: Iterable[Any] = ()) -> Motion:
    """Return what `DirectSimulator.simulate` does, with the Stepper that `make` makes."""
    grippers = poses(grippers, 1)
    dt = number('dt', dt, above=0)
    tolerance = motion_tolerance(tolerance, simulator.rod.length)
    choice('integrator', integrator, INTEGRATORS)
    refuse_motion(simulator.surroundings, simulator.strains)
    goes_on, fastest = isinstance(initial, Motion), 0.0
    if isinstance(initial, Motion):
        if not len(initial):
            raise InvalidTask('initial: expected a Motion with instants, it has none')
        if velocity is None:
            velocity = initial.velocities[-1]
            fastest = fastest_of(initial)
        initial = initial.shapes[-1]
    simulator._check(grippers[0], initial)
    held = held_by(far_ends, holds, len(grippers), simulator.rod.length)
    for gripper, there in zip(grippers, held, strict=True):
        simulator._check(gripper, None, there)
    if have_rings(held[0]):
        raise InvalidTask(f'holds = {shown(held[0])}: expected none that the DLO slides through: '
                          'that is known at rest only')
    grips = moving_grips(grippers, held, dt, velocity is None, initial)
    plan = IntegrationOptions(len(grippers), integrator, tolerance)
    with interrupted_by(steps.check):
        start, mesh = simulator._beginning(grippers[0], held[0], initial, goes_on)
        begun = InitialConditions(initial, start, nodes_velocity(velocity, initial, start), fastest)
        return simulate(make(mesh, grips, dt, simulator.method), begun, plan, steps)


def clamping(name: str, simulator: object) -> DirectSimulator:
    """Return a DirectSimulator of which plans are made; raise InvalidTask naming `name`."""
    direct: DirectSimulator = instance(name, simulator, DirectSimulator)
    if direct.surroundings.pinned:
        raise InvalidTask(f'{name}.grip = \'pinned\': expected \'clamped\', which plans are made '
                          'for')
    if direct.surroundings.self_contact:
        raise InvalidTask(f'{name}.self_contact = True: expected False: plans and '
                          'estimates do not take contact with itself into account')
    return direct


_OPTIONS = tuple(name for name in signature(DirectSimulator).parameters
                 # what holds the DLO is theirs to say; parts of a DLO do not know each other
                 if name not in ('rod', 'grip', 'self_contact', 'self_friction'))


def known_options(options: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a dict of options of `DirectSimulator`; raise InvalidTask if there is another."""
    for name in options:
        choice('option', name, _OPTIONS)
    return options


def _signal(error: BaseException) -> BaseException:
    """Return the KeyboardInterrupt that numba has made an error of; the error itself, if none."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            return cause
        cause = cause.__cause__ or cause.__context__
    return error
