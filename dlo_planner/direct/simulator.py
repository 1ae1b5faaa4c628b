# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The direct simulator: from gripper poses to shapes."""

from collections.abc import Callable, Iterable, Mapping
from inspect import signature
from typing import Any

from numpy.typing import ArrayLike

from dlo_planner.deprecated import renamed
from dlo_planner.direct.accuracy import default_accuracy, first_mesh, mesh_to_begin_with, within
from dlo_planner.direct.beginning import Velocity
from dlo_planner.direct.described import STRAINS
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.grips import ends_of, poses
from dlo_planner.direct.mesh import even_mesh
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.moving import Moving, Prescribed
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.stepping import Stepper
from dlo_planner.direct.surroundings import STANDARD_GRAVITY, Surroundings, judge_method
from dlo_planner.errors import InvalidTask
from dlo_planner.minimize.methods import METHODS
from dlo_planner.model.checks import choice, instance, integer, number, shown
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.point_load import PointLoad
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import put
from dlo_planner.progress import OnProgress, Progress
from dlo_planner.ritz.series import BASES, converging


class DirectSimulator(Moving):
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
        paper's methods keep them anyway.
    gravity : array_like, shape (3,), optional
        Gravity in m/s^2, any direction, may be zero.
    load : array_like or callable, optional
        Further force per length, N/m, world axes: (3,), or a callable of s (m).
    obstacles : Iterable, optional
        Plane, Sphere, Capsule, Cylinder, Box or Sheet, in any number.
    point_loads : Iterable, optional
        PointLoads, dead forces and moments at points.
    grip : str, optional
        'clamped' (default), or 'pinned': the gripper holds the position of the DLO's beginning,
        which may turn like in a ball joint. A shape's gripper and first frame then have the
        rotation of the equilibrium; of a given pose the rotation is only where the search begins,
        without a shape before.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    def __init__(self, rod: Rod, *, n_elements: int | None = None, n_terms: int | None = None,
                 basis: str | None = None, method: str = 'newton', strains: str = 'components',
                 accuracy: float | None = None, gravity: ArrayLike = STANDARD_GRAVITY,
                 load: ArrayLike | Callable[[float], ArrayLike] | None = None,
                 obstacles: Iterable[Obstacle] = (), point_loads: Iterable[PointLoad] = (),
                 grip: str = 'clamped') -> None:
        given: Any = {'gravity': gravity, 'load': load, 'obstacles': obstacles,
                      'point_loads': point_loads}  # judged there
        around = Surroundings(rod, grip=grip, **given)
        fixed = n_elements is not None or n_terms is not None
        put(self, surroundings=around, _history=None, method=choice('method', method, METHODS),
            strains=choice('strains', strains, STRAINS),
            basis='chebyshev' if basis is None else choice('basis', basis, BASES))
        put(self, _fine='local' if basis is None else converging(self.basis))
        judge_method(around, self.method, self.strains, self.basis)
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

    def solve(self, gripper: Pose, initial: Shape | None = None, *,
              far_end: FarEnd | Pose | ArrayLike | None = None) -> Shape:
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
            end is free.

        Returns
        -------
        Shape
            `converged` is False if no equilibrium was found; that raises no exception.
        """
        far_end = FarEnd.of(far_end)
        self._check(gripper, initial, far_end)
        if initial is None or not (self._made(initial) or initial.state.kept):
            return self._equilibrium(gripper, initial, far_end)[0]
        return self._followed(initial, gripper, far_end, at_once=True)

    def track(self, grippers: Iterable[Pose], progress: OnProgress = None,
              initial: Shape | None = None, *, far_ends: Iterable[Any] | None = None,
              deadline: float | None = None) -> list[Shape]:
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
        deadline : float, optional
            Seconds of computing after which DeadlineExceeded is raised. If None, no limit.

        Raises
        ------
        InvalidTask
            An argument makes no sense; the message names it.
        """
        grippers = poses(grippers)
        steps = Progress(progress, deadline)
        ends = ends_of(far_ends, len(grippers))
        shapes = []
        for gripper, end in zip(grippers, ends, strict=True):
            self._check(gripper, initial, end)
            before = self._settled(initial)
            if before is None:
                shape, _ = self._equilibrium(gripper, initial, end)
            else:
                shape = self._followed(before, gripper, end)
            shapes.append(shape)
            if shape.converged or shape.nearly:  # a failure is reported, not carried on
                initial = shape
            steps.done(len(shapes), len(grippers))
        return shapes

    def simulate(self, grippers: Iterable[Pose], dt: float,
                 initial: Shape | Motion | None = None, *, far_ends: Iterable[Any] | None = None,
                 velocity: Velocity | None = None, tolerance: float | None = None,
                 integrator: str = 'generalized_alpha', progress: OnProgress = None,
                 deadline: float | None = None) -> Motion:
        """Return the Motion of the DLO under moving grips, with inertia and damping.

        Between the instants the grips move along cubic splines with continuous accelerations
        (`direct.guide.Guide`), from rest at time 0 unless the DLO moves there. Steps are halved
        where their local error, a gain of energy or Newton's method asks for it.

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
        return self._motion(Stepper, Prescribed(grippers, dt, initial, far_ends, velocity,
                                                tolerance, integrator),
                            Progress(progress, deadline))


    discretisation = renamed('discretisation', 'discretization')

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
            return self._discretization
        if (shape is not None and self._made(shape)
                and shape.state.made_on.basis in (self.basis, self._fine)
                and within(shape, self.accuracy)):
            return shape.state.made_on
        return self._equilibrium(gripper, shape, None)[0].state.made_on

    def mesh_after(self, shape: Shape | None) -> Discretization:
        """Return the Discretization on which what follows a Shape, or None, is sought first."""
        return mesh_to_begin_with(self._discretization, self._fine, self.accuracy,
                                  instance('shape', shape, Shape, optional=True), self._history)


def clamping(name: str, simulator: object) -> DirectSimulator:
    """Return a DirectSimulator whose gripper clamps the DLO; raise InvalidTask naming `name`."""
    direct: DirectSimulator = instance(name, simulator, DirectSimulator)
    if direct.surroundings.pinned:
        raise InvalidTask(f'{name}.grip = \'pinned\': expected \'clamped\', which plans are made '
                          'for')
    result: DirectSimulator = direct
    return result


_OPTIONS = tuple(name for name in signature(DirectSimulator).parameters
                 if name not in ('rod', 'grip'))  # what holds the DLO is theirs to say


def known_options(options: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a dict of options of `DirectSimulator`; raise InvalidTask if there is another."""
    for name in options:
        choice('option', name, _OPTIONS)
    return options
