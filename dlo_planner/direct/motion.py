# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The answer of a dynamic simulation."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.shape import Shape, pack, unpack
from dlo_planner.direct.storage import load, save
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, estimate, figure, items, results, shown
from dlo_planner.model.value import Constant, brief, freeze, put
from dlo_planner.pictured import Filmed
from dlo_planner.progress import OnProgress, Progress, interrupted_by

STATUSES = ('complete', 'unsolved', 'energy', 'blocked', 'self-passage')
_UNFINISHED = 'unsolved', 'blocked'  # with the shape of a step that could not be solved
_ARRAYS = ('times', 'velocities', 'kinetic_energy', 'potential_energy', 'work', 'losses')
# How often it may be asked whether to end while `error_estimate` is computed: kernels do so after
# the same work on every machine, about each 10 ms, and what calls them where they have ended, about
# each millisecond of a DLO that hangs freely.
_AT_ONCE = 600
_FIGURES = ('tolerance', 'status', 'message')


class Instant(NamedTuple):
    """One instant of a Motion: what `Motion` says of it under the same names, in the singular."""

    time: float
    shape: Shape
    velocities: Floats
    kinetic_energy: float
    potential_energy: float
    work: float
    losses: Floats


class Deferred(NamedTuple):
    """Shapes of a complete motion that are made when they are first asked for."""

    make: Callable[[], tuple[Shape, ...]]


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Filmed):
    """A DLO in motion at n instants.

    Attributes
    ----------
    times : ndarray, shape (n,)
        Times in s; of a motion that ended early, the last one is where it could not go on: where
        the step that could not be solved ends, or the last instant before one that gained energy.
    shapes : tuple of Shape
        The n shapes; residual and stability are those of the step's minimization, gripper_wrench
        includes inertia and damping (nan at time 0 of a motion from full length), error_estimate is
        infinite (not known).
    velocities : ndarray, shape (n, N_L + 1, 3)
        Velocities of the nodes, m/s, world axes.
    kinetic_energy : ndarray, shape (n,)
        Kinetic energy in J; gravity's zero at the world's origin.
    potential_energy : ndarray, shape (n,)
        Potential energy in J; gravity's zero at the world's origin.
    work : ndarray, shape (n,) or None
        Work of the gripper and of holds on the DLO since time 0, J.
    losses : ndarray, shape (n, 3) or None
        Energy lost since time 0 to damping, plastic deformation and friction, J.
    tolerance : float
        The tolerance that was asked for, m.
    status : str
        'complete'; 'unsolved': a step could not be solved; 'energy': a step gained energy, however
        short it was made; 'blocked': the gripper, or what else holds the DLO, is led into an
        obstacle, with the axis of the DLO, or grips out of reach of each other, so that no shape
        can follow; 'self-passage': the motion
        has come to its end, but on the way the DLO passed through itself (the shapes from there on
        say so).
    message : str
        Why the motion is not complete, and when; else ''.
    """

    times: Floats
    shapes: tuple[Shape, ...]
    velocities: Floats
    kinetic_energy: Floats
    potential_energy: Floats
    work: Floats | None = None
    losses: Floats | None = None
    tolerance: float = np.inf
    status: str = 'complete'
    message: str = ''
    # of the work that it may take at most
    _estimate: Callable[[float], Floats] | None = field(default=None, compare=False)

    _REMEMBERED = ('error_estimate',)

    def __post_init__(self) -> None:
        shapes: Any = self.__dict__.pop('shapes')
        if isinstance(shapes, Deferred):
            n = len(self.times)
            put(self, _deferred=shapes)
        else:
            put(self, shapes=items('Motion.shapes', shapes, Shape))
            n = len(self.shapes)
        work = np.zeros(n) if self.work is None else self.work
        losses = np.zeros((n, 3)) if self.losses is None else self.losses
        put(self, velocities=results('Motion.velocities', self.velocities, (n, None, 3)),
            losses=results('Motion.losses', losses, (n, 3)),
            work=results('Motion.work', work, (n,)),
            tolerance=figure('Motion.tolerance', self.tolerance),
            status=choice('Motion.status', self.status, STATUSES),
            **{name: results(f'Motion.{name}', getattr(self, name), (n,))
               for name in ('times', 'kinetic_energy', 'potential_energy')})
        if not isinstance(self.message, str):
            raise InvalidTask(f'Motion.message = {shown(self.message)}: expected a string')
        put(self, _estimate=estimate('Motion._estimate', self._estimate, n))
        super().__post_init__()

    def __getattr__(self, name: str) -> Any:
        """Make the shapes: of short steps it takes as long as to find them."""
        if name != 'shapes' or '_deferred' not in self.__dict__:
            raise AttributeError(f'Motion has no attribute {name!r}')
        put(self, shapes=self.__dict__.pop('_deferred').make())
        return self.__dict__[name]

    def __getstate__(self) -> dict[str, Any]:
        assert self.shapes is not None  # made, if they are not yet
        return super().__getstate__()

    def __repr__(self) -> str:
        return brief(self, f'{len(self)} instants',
                     f'{self.times[-1]:.4g} s' if len(self) else '',
                     'converged' if self.converged else 'not converged',
                     '' if self.status == 'complete' else self.status)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the motion as npz, or JSON (see `Plan.save`): all but rod and surroundings.

        The error estimate is written if it was read before; else it will be nan, not known.
        """
        tree = {name: getattr(self, name) for name in (*_ARRAYS, *_FIGURES)}
        tree['error_estimate'] = self.__dict__.get('error_estimate', np.full(len(self), np.nan))
        save(path, tree | {str(k): pack(shape) for k, shape in enumerate(self.shapes)}, 'Motion')

    @classmethod
    def load(cls, path: str | PathLike[str]) -> 'Motion':
        """Return the Motion saved at `path`.

        Raises
        ------
        InvalidTask
            Not such a file.
        """
        return load(path, cls._read, 'Motion')

    @classmethod
    def _read(cls, tree: Mapping[str, Any]) -> 'Motion':
        shapes = tuple(unpack(tree[str(k)]) for k in range(len(tree['times'])))
        return cls(shapes=shapes, **{name: tree[name] for name in _ARRAYS},
                   **{name: tree[name].item() for name in _FIGURES},
                   _estimate=Constant(tree['error_estimate']))

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, index: int | slice) -> 'Instant | tuple[Instant, ...]':
        """Return one Instant, or several."""
        return self._instants[index]

    def __iter__(self) -> Iterator['Instant']:
        return iter(self._instants)

    @property
    def _instants(self) -> 'tuple[Instant, ...]':
        columns: Any = (self.times, self.shapes, self.velocities, self.kinetic_energy,
                        self.potential_energy, self.work, self.losses)
        return tuple(map(Instant, *columns))

    @property
    def energy(self) -> Floats:
        """(n,) kinetic and potential energy, J."""
        return self.kinetic_energy + self.potential_energy

    @property
    def dissipated(self) -> Floats:
        """(n,) J, taken since time 0 by damping, plastic deformation and friction."""
        losses: Any = self.losses  # see __post_init__
        result: Floats = losses.sum(axis=1)
        return result

    @property
    def numerical_loss(self) -> Floats:
        """(n,) J, taken since time 0 by the integrator, and by impacts on obstacles.

        energy + dissipated + numerical_loss = energy at time 0 + work. Where the DLO slides along a
        convex obstacle it may fall again, by the work of contacts along the chords of steps, though
        hardly below zero. It is nan where the last step was not solved.
        """
        if not len(self):
            return np.zeros(0)
        result: Floats = self.energy[0] + self.work - self.energy - self.dissipated
        if len(self) > 1 and self.status in _UNFINISHED and not self.shapes[-1].converged:
            result[-1] = np.nan
        return result

    @cached_property
    def error_estimate(self) -> Floats:
        """(n,) largest distance of a node from the true rod's until each instant, m.

        From a second run with every element and every step halved, made when this is first read,
        of about half a second at most. What comes after that is compared with a run on elements and
        by steps twice as long, which takes about a quarter of the time of the motion (among
        obstacles it may be made twice, in some seconds), and tells less exactly: there it is
        twice that difference. `estimate_error` halves all.
        A motion that begins at rest does so there, too: the error of a given Shape at rest is part
        of it. Where neither run could follow, or they part by a quarter of the length, as where a
        DLO may buckle to any side, it is twice the length: no shapes in one gripper are farther
        apart. Where a straight DLO buckles between grips and nothing given tells how, it is at
        least as far as two shapes in these grips may be apart. It is nan for a motion that does not
        know: from a file, saved before it was read, or without a shape at time 0, as `message` says
        then.
        """
        return self._estimated(_AT_ONCE)

    def estimate_error(self, *, progress: OnProgress = None,
                       deadline: float | None = None) -> Floats:
        """Return `error_estimate` (n,), m, with all elements and steps halved, and remember it.

        It costs two to eight times as much as the motion. Where that run cannot follow, it is that
        of elements and steps twice as long.

        Parameters
        ----------
        progress : callable, optional
            Called as progress(1, 1) when it is found.
        deadline : float, optional
            Seconds of computing after which DeadlineExceeded is raised. If None, no limit.

        Raises
        ------
        InvalidTask
            An argument makes no sense; the message names it.
        DeadlineExceeded
            The deadline is over; `error_estimate` is what it was.
        """
        steps = Progress(progress, deadline)
        with interrupted_by(steps.check):
            found = self._estimated(np.inf)
        self.__dict__['error_estimate'] = found
        steps.done(1, 1)
        return found

    def _estimated(self, most: float) -> Floats:
        assert self._estimate is not None  # see __post_init__
        found = self._estimate(most)
        freeze(found)
        return found

    @property
    def within_tolerance(self) -> bool:
        """Whether the error estimate is, all of it; as expensive as that when first read."""
        return bool(self.converged and np.all(self.error_estimate <= self.tolerance))

    @property
    def converged(self) -> bool:
        """Whether every step was solved, without a gain of energy."""
        return self.status == 'complete' and (
            '_deferred' in self.__dict__ or all(shape.converged for shape in self.shapes))
