# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a simulator computes with: a DLO, what surrounds it, a mesh, a permanent set; variants."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Self

import numpy as np

from dlo_planner.direct.accuracy import Wanted, accurate_equilibrium
from dlo_planner.direct.continuation import Equilibrium, follow
from dlo_planner.direct.culling import Acts, Culled
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.history import History
from dlo_planner.direct.mesh import with_breaks
from dlo_planner.direct.one_step import How, step
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.errors import InvalidTask
from dlo_planner.model.along import Stepwise
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, shown
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Value, brief, figures, put, same

_FARTHEST = 10  # of the length: from where a held far end may be brought


class Setup(Value):
    """The setup of a DirectSimulator; a base of it.

    Attributes
    ----------
    surroundings : Surroundings
    method, strains, basis : str
        As of `DirectSimulator`.
    accuracy : float or None
        In m. If None, the mesh is fixed.
    """

    PARTS = ('surroundings', 'method', 'strains', 'accuracy', 'basis', '_fine', '_history',
             '_discretization')

    surroundings: Surroundings
    method: str
    strains: str
    basis: str
    accuracy: float | None
    _fine: str
    _history: History | None
    _discretization: Discretization

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
    def history(self) -> History | None:
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
        return self._changed(_history=past.lasting())

    def left_by(self, shape: Shape) -> Self:
        """Return the simulator of the DLO as `shape` leaves it: with its set, if it has any.

        Raises
        ------
        InvalidTask
            Not a Shape of this DLO, or of one that is grasped inside.
        """
        instance('initial', shape, Shape)
        self._check(shape.gripper, shape)
        past = shape.state.history
        return self if past is None or not past.lasts else self.with_set(shape)

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
            free |= {'natural_curvature': Stepwise(mesh.s, strains[:, 1:]),
                     'natural_twist': Stepwise(mesh.s, strains[:, 0])}
        return self._with(replace(self.surroundings, rod=replace(rod, **free)), None)

    def without_obstacles(self) -> Self:
        """Return a simulator of the same DLO, set as it is, with nothing in its way."""
        if not self.obstacles:
            return self
        return self._with(replace(self.surroundings, obstacles=()), self._history)

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

    def _with(self, surroundings: Surroundings, history: History | None) -> Self:
        mesh, share = self._discretization, surroundings.rod.length / self.rod.length
        s = with_breaks(np.append(mesh.s[:-1] * share, surroundings.rod.length),
                        surroundings.breaks)
        accuracy = None if self.accuracy is None else self.accuracy * share
        return self._changed(
            surroundings=surroundings, _history=history, accuracy=accuracy,
            _discretization=Discretization(surroundings, s, mesh.basis, mesh.n_terms))

    def _equilibrium(self, gripper: Pose, initial: Shape | None, far_end: FarEnd | None,
                     most: float = np.inf) -> tuple[Shape, int]:
        """Return (Shape, kicks); `most` as in `one_step.How`."""
        self._judge_end(far_end)

        def find(find_one: Equilibrium, begin: Shape | None) -> tuple[Shape, int]:
            return find_one(gripper, begin, far_end, most)

        return self._found(find, initial, far_end)

    def _followed(self, previous: Shape, gripper: Pose, far_end: FarEnd | None,
                  at_once: bool = False) -> Shape:
        """Return what `continuation.follow` does."""
        self._judge_end(far_end)

        def find(find_one: Equilibrium, begin: Shape | None) -> tuple[Shape, int]:
            assert begin is not None  # as `previous` is not
            return follow(find_one, begin, gripper, far_end, at_once), 0

        return self._found(find, previous, far_end)[0]

    def _found(self, find: Callable[[Equilibrium, Shape | None], tuple[Shape, int]],
               initial: Shape | None, far_end: FarEnd | None) -> tuple[Shape, int]:
        """Return what `find` does: without what may act, if it does not; else with all of that.

        Parameters
        ----------
        find : callable
            Function of an equilibrium as `_with_all`, and the Shape to begin with.
        initial : Shape or None
            That Shape.
        far_end : FarEnd or None
        """
        culled = None
        if (self.method == 'newton' and self._history is None
                and (far_end is None or initial is not None)):
            culled = Culled.of(self._discretization, initial)
        if culled is not None:
            try:
                shape, kicks = find(partial(self._without, culled), culled.begin)
            except Acts:
                pass
            else:
                if shape.converged:
                    return culled.with_all(shape), kicks
        return find(self._with_all, initial)

    def _without(self, culled: Culled, gripper: Pose, initial: Shape | None,
                 far_end: FarEnd | None, most: float) -> tuple[Shape, int]:
        """Return what `_with_all` does without what may act; raise Acts if that does."""
        shape, kicks = self._on(self._discretization.free, gripper, initial,
                                How(None, far_end, most=most))
        if shape.converged:
            culled.judged(initial, gripper, shape)
        return shape, kicks

    def _with_all(self, gripper: Pose, initial: Shape | None, far_end: FarEnd | None,
                  most: float) -> tuple[Shape, int]:
        """Return (Shape, kicks), with all that may act."""
        return self._on(self._discretization, gripper, initial,
                        How(self._history, far_end, self.method, self.strains, most))

    def _on(self, mesh: Discretization, gripper: Pose, initial: Shape | None,
            how: How) -> tuple[Shape, int]:
        if self.accuracy is not None:
            return accurate_equilibrium(Wanted(mesh, self._fine, self.accuracy), gripper, initial,
                                        how)
        return step(mesh, gripper, initial, how)

    def _judge_end(self, far_end: FarEnd | None) -> None:
        if far_end is not None and self.method != 'newton':
            raise InvalidTask(f'method = {self.method!r}: expected \'newton\' with a far end')

    def _settled(self, shape: Shape | None) -> Shape | None:
        """Return what a Shape or None, made anywhere, becomes here in its grippers; or None."""
        if shape is None or self._made(shape):
            return shape
        found, _ = self._equilibrium(shape.gripper, shape, shape.far_end)
        return found if found.converged else None

    def _made(self, shape: Shape) -> bool:
        """Whether a Shape is of this DLO, with all that acts on it here."""
        known = shape.state.mesh
        return known is not None and same(known.surroundings, self.surroundings)

    def _check(self, gripper: Pose, initial: Shape | None,
               far_end: FarEnd | None = None) -> None:
        instance('gripper', gripper, Pose)
        instance('initial', initial, Shape, optional=True)
        if initial is not None and initial.parts is not None:
            raise InvalidTask(f'initial = {initial!r}: expected one of a DLO that is held at its '
                              'beginning, not grasped inside')
        if far_end is not None:  # its grip, and the gripper, go there step by step
            self._near(gripper, 'far_end', far_end.pose)
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


def made_by(simulator: Setup, shape: Shape) -> bool:
    """Whether a Shape is of a simulator's DLO, with all that acts on it there."""
    return simulator._made(shape)
