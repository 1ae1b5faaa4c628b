# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The answer of the direct simulation: a shape, with its proof."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.contacts import Contact
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.history import History, mapped
from dlo_planner.direct.modes import Modes, modes_of
from dlo_planner.direct.storage import load, pack, save, unpack
from dlo_planner.direct.vibration import Linearized
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import (
    array,
    flag,
    instance,
    integer,
    items,
    number,
    row,
    shown,
    vector,
)
from dlo_planner.model.computed import figure
from dlo_planner.model.far_end import FarEnd, distance, within_reach
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Constant, brief, freeze, put
from dlo_planner.pictured import Pictured
from dlo_planner.ritz.kinematics import point_inside

_ROUNDING = 1e-9  # of the length
_NEARLY, _STABLE, _KEPT = 1e-4, 1e-3, 1e-6  # what a shape is not to exceed to go on from it


@dataclass(frozen=True, eq=False, repr=False)
class Shape(Pictured):
    """A static shape of a DLO held by a gripper; N_L elements, N_L + 1 nodes, world frame, SI.

    Two shapes are equal if all that is listed here is, and the past that the next step begins with.

    Attributes
    ----------
    gripper : Pose
        The pose for which it was computed.
    s : ndarray, shape (N_L + 1,)
        Arc lengths of the nodes, m, 0 at the gripper.
    positions : ndarray, shape (N_L + 1, 3)
        Positions in m.
    frames : ndarray, shape (N_L + 1, 3, 3)
        Columns are tangent t, normals n and b (the material frame).
    element_strains : ndarray, shape (N_L, 3)
        Torsion, curvature about n, about b; 1/m, constant per element.
    energy : float
        Total potential, J, gravity's zero at the world's origin.
    elastic_energy : float
        The part of it that is stored in the DLO, J.
    gripper_wrench : ndarray, shape (6,)
        Force (N) and moment about the gripper's origin (N m) that the gripper exerts on the DLO,
        world axes.
    residual : float
        Size of the gradient of the potential, relative to the elastic energy and that of a 1 rad
        bend: whether the minimizer finished.
    stability : float
        Smallest eigenvalue of the Hessian relative to the elastic one; > 0 a minimum, 0 neutral
        (the shape is one of many), < 0 not stable.
    iterations : int
        Newton steps.
    evaluations : int
        Evaluations of the potential, where the method counts them.
    converged : bool
        The residual is below 1e-8 (1e-7 among obstacles, or what rounding errors leave of it where
        constrained), the shape is stable or neutral, no contact is violated by more than 1e-6 of
        the length and no grip by more than 1e-9, and the accuracy was reached.
    jumped : bool
        The shape is not the continuation of the one it was started from, or is one of several into
        which that one splits.
    contacts : tuple
        The Contacts, in the order of s.
    violation : float
        By how much a constraint (contact, far end) is violated, m.
    far_end : FarEnd or None
        What holds the far end; None if it is free.
    far_wrench : ndarray, shape (6,)
        As `gripper_wrench`, at the far end, moment about it.
    dissipated : float
        Energy lost to plastic deformation so far, J.
    parts : tuple or None
        The two Shapes of a DLO grasped inside (`GraspedInside`), else None.
    """

    gripper: Pose
    s: np.ndarray
    positions: np.ndarray
    frames: np.ndarray
    element_strains: np.ndarray
    energy: float
    elastic_energy: float
    gripper_wrench: np.ndarray
    residual: float
    stability: float
    iterations: int
    converged: bool
    jumped: bool = False
    contacts: tuple = ()
    evaluations: int = 0
    violation: float = 0.0
    far_end: FarEnd | None = None
    far_wrench: np.ndarray = field(default_factory=lambda: np.zeros(6))
    dissipated: float = 0.0
    parts: tuple | None = None
    _estimate: Callable = field(default=Constant(np.nan), compare=False)
    _discretization: Discretization | None = field(default=None, compare=False)
    _history: History | None = None                            # what it leaves to the next step
    _before: History | None = field(default=None, compare=False)  # what the step began with

    REMEMBERED = ('error_estimate',)

    def __post_init__(self):
        if not isinstance(self._discretization, Discretization):  # else a simulator made it
            self._judge()
        for content in (self.s, self.positions, self.frames, self.element_strains,
                        self.gripper_wrench, self.far_wrench):
            freeze(content)

    def _judge(self):
        """Check what comes from elsewhere."""
        instance('Shape.gripper', self.gripper, Pose)
        s = row('Shape.s', self.s, least=2, minimum=0)
        if s[0] != 0 or (np.diff(s) <= 0).any():
            raise InvalidTask(f'Shape.s = {shown(s.tolist())}: expected arc lengths that grow '
                              'from 0')
        put(self, s=s, contacts=items('Shape.contacts', self.contacts, Contact),
            **{name: array(f'Shape.{name}', getattr(self, name), (s.size, *size))
               for name, size in (('positions', (3,)), ('frames', (3, 3)))},
            **{name: array(f'Shape.{name}', getattr(self, name), size) for name, size in (
                ('element_strains', (s.size - 1, 3)), ('gripper_wrench', (6,)),
                ('far_wrench', (6,)))},
            **{name: figure(f'Shape.{name}', getattr(self, name)) for name in (
                'energy', 'elastic_energy', 'residual', 'stability', 'violation', 'dissipated')},
            **{name: integer(f'Shape.{name}', getattr(self, name), minimum=0, maximum=10**12)
               for name in ('iterations', 'evaluations')},
            **{name: flag(f'Shape.{name}', getattr(self, name))
               for name in ('converged', 'jumped')})
        instance('Shape.far_end', self.far_end, FarEnd, optional=True)
        instance('Shape._discretization', self._discretization, Discretization, optional=True)
        for name in ('_history', '_before'):
            instance(f'Shape.{name}', getattr(self, name), History, optional=True)
        if not callable(self._estimate):
            raise InvalidTask(f'Shape._estimate = {shown(self._estimate)}: expected a function')
        if self.parts is not None:
            put(self, parts=items('Shape.parts', self.parts, Shape, least=2))

    def __repr__(self):
        cheap = not (self.contacts or self.far_end or self.rod is None or self.rod.yields)
        known = cheap or 'error_estimate' in self.__dict__
        return brief(self, f'{self.s[-1]:.4g} m', f'{len(self.element_strains)} elements',
                     'converged' if self.converged else 'not converged',
                     'jumped' if self.jumped else '', f'residual {self.residual:.1g}',
                     f'stability {self.stability:.2g}',
                     f'error {self.error_estimate:.1g} m' if known else '',
                     f'{len(self.contacts)} contacts' if self.contacts else '')

    @property
    def nearly(self) -> bool:
        """Whether it is not `converged`, but good enough to go on from (`DirectSimulator.track`).

        It is stable, keeps all constraints, and its residual is below 1e-4.
        """
        return bool(not self.converged and not self.jumped and self.residual < _NEARLY
                    and self.stability > -_STABLE and self.violation <= _KEPT * self.s[-1]
                    and self._within_reach)

    @property
    def status(self) -> str:
        """How the computation ended, in words: 'converged', 'nearly converged', or why not."""
        if not self._within_reach:
            return (f'out of reach: the far end is held {distance(self.far_end, self.gripper):.9g} '
                    f'm from the gripper, the DLO is {self.s[-1]:.9g} m long')
        figures = (f'residual {self.residual:.2g}, stability {self.stability:.2g}, '
                   f'violation {self.violation:.2g} m')
        if self.converged:
            return 'converged, jumped' if self.jumped else 'converged'
        if self.nearly:
            return f'nearly converged: {figures}'
        return f'not converged{", jumped" if self.jumped else ""}: {figures}'

    @property
    def _within_reach(self):
        loaded = self._discretization is None or self._discretization.loaded
        return within_reach(self.far_end, self.gripper, float(self.s[-1]), loaded)

    @property
    def tangents(self) -> np.ndarray:
        """(N_L + 1, 3) unit tangents at the nodes."""
        return self.frames[:, :, 0]

    @property
    def strains(self) -> np.ndarray:
        """(N_L + 1, 3) strains at the nodes, 1/m, interpolated from the elements' middles."""
        u = self.element_strains
        if len(u) == 1:
            return np.repeat(u, 2, axis=0)
        h = np.diff(self.s)[:, None]
        inner = (h[1:] * u[:-1] + h[:-1] * u[1:]) / (h[1:] + h[:-1])
        first = u[0] - (u[1] - u[0]) * h[0] / (h[0] + h[1])
        last = u[-1] + (u[-1] - u[-2]) * h[-1] / (h[-1] + h[-2])
        return np.vstack([first, inner, last])

    @cached_property
    def error_estimate(self) -> float:
        """Largest distance of a node from the true rod's, m.

        From an embedded solution with every element halved and freed from the series (computed
        when first read; it costs about as much as the solution itself).
        """
        return self._estimate()

    def at(self, s: float) -> Pose:
        """Return the Pose (x axis = tangent) at arc length `s` in m, on the element's exact arc.

        Raises
        ------
        InvalidTask
            `s` is outside [0, L].
        """
        s = number('s', s, minimum=0, maximum=float(self.s[-1]))
        rotation, position = self.frame_at(s)
        return Pose.from_rotation(position, rotation)

    def positions_at(self, s: ArrayLike) -> np.ndarray:
        """Return (m, 3) positions in m at arc lengths `s` (m,) in m, as `at`, but quicker.

        Raises
        ------
        InvalidTask
            One is outside [0, L].
        """
        s = row('s', s, least=0, minimum=0, maximum=float(self.s[-1]))
        return np.array([self.frame_at(value)[1] for value in s]).reshape(-1, 3)

    def frame_at(self, s: float) -> tuple[np.ndarray, np.ndarray]:
        """Return axes (3, 3) and position (3,) at `s` in m: `at` for inner loops.

        Raises
        ------
        InvalidTask
            `s` is outside [0, L] by more than rounding.
        """
        length = self.s[-1]
        if not (isinstance(s, float) and 0.0 <= s <= length):
            s = number('s', s, minimum=-_ROUNDING * length, maximum=(1 + _ROUNDING) * length)
            s = min(max(s, 0.0), length)
        element = min(int(self.s.searchsorted(s, side='right')) - 1, self.s.size - 2)
        kernels = self.for_kernels
        rotation, position = np.empty((3, 3)), np.empty(3)
        point_inside(*kernels, element, (s - self.s[element]) / kernels[0][element], rotation,
                     position)
        return rotation, position

    @cached_property
    def for_kernels(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Lengths (N,), strains (N, 3), frames and positions of the nodes, for kernels alone.

        Copies: read-only arrays are another type for numba, and would compile everything again.
        """
        return (np.diff(self.s), self.element_strains.copy(), self.frames.copy(),
                self.positions.copy())

    @property
    def rod(self) -> Rod | None:
        """The Rod; None for a shape from a file."""
        return None if self._discretization is None else self._discretization.rod

    @property
    def mesh(self) -> Discretization | None:
        """The Discretization it was computed on; None for a shape from a file."""
        return self._discretization

    @property
    def history(self) -> History | None:
        """What the DLO carries to the next step: its permanent set and its contacts."""
        return self._history

    @property
    def pinned(self) -> bool:
        """Whether its beginning is pinned by the gripper, not clamped (a simulator's `grip`)."""
        return self._discretization is not None and self._discretization.surroundings.pinned

    @property
    def bend_radius(self) -> np.ndarray:
        """(N_L,) radius of curvature of the elements, m; infinite where straight."""
        with np.errstate(divide='ignore'):
            return 1 / np.hypot(self.element_strains[:, 1], self.element_strains[:, 2])

    @property
    def bend_margin(self) -> float:
        """How much less than the rod's max_bend_curvature the sharpest bend is, 1/m (< 0: more).

        Infinite without a limit.
        """
        limit = None if self.rod is None else self.rod.max_bend_curvature
        return np.inf if limit is None else float(limit - 1 / self.bend_radius.min())

    @property
    def bent(self) -> np.ndarray:
        """(N_L, 3) strains since the stress-free shape, permanent set included there, 1/m.

        Raises
        ------
        InvalidTask
            The shape comes from a file and does not know its rod.
        """
        if self._discretization is None:
            raise InvalidTask('this shape does not know its rod: expected one from a simulator')
        return self.element_strains - self._discretization.stress_free(self._history)

    @property
    def surface_strain(self) -> np.ndarray:
        """(N_L, 2) largest axial and shear strain at the surface; needs `Rod.section`."""
        return self._section().surface_strain(self.bent)

    @property
    def surface_stress(self) -> np.ndarray:
        """(N_L, 2) largest axial and shear stress at the surface, Pa; needs `Rod.section`.

        Elastic, and so an upper bound where the section has yielded.
        """
        section = self._section()
        return self.surface_strain * np.array([section.youngs_modulus, section.shear_modulus])

    def _section(self):
        if self.rod is None or self.rod.section is None:
            raise InvalidTask('Rod.section = None: expected a Section where strain and stress at '
                              'the surface are asked for (Rod.circular and the like give one)')
        return self.rod.section

    def modes(self, n: int = 4) -> Modes:
        """Return the n slowest vibrations of the DLO about this shape, the grips at rest.

        Contacts that bear stay closed, what yields springs back. There are fewer than n where the
        masses cannot move in as many ways. About 1 ms with a series, see `Modes.error_estimate`.

        Raises
        ------
        InvalidTask
            The shape is not converged, neutral, one of a motion, grasped inside (take its `parts`)
            or from a file; dead moments act, or it touches something with friction.
        """
        return modes_of(self, n)

    def stiffness_matrix(self) -> np.ndarray:
        """Return (c, c), J: second derivative of the potential by the coordinates of vibrations.

        Coordinates are what the simulator minimizes by, term after term of its series ('local':
        element after element), for each torsion, curvature about n, about b. Their unit is sqrt(J),
        so scaled that the elastic part is the identity (where the stiffness does not vary along the
        DLO). A held far end leaves combinations of these. `jacobian` says what they move.

        Raises
        ------
        InvalidTask
            As `modes`.
        """
        return Linearized(self).vibration.stiffness

    def mass_matrix(self) -> np.ndarray:
        """Return (c, c), J s^2: second derivative of the kinetic energy by the velocities.

        In the coordinates of `stiffness_matrix`, for shapes as there; it may be singular.
        """
        return Linearized(self).vibration.mass

    def jacobian(self) -> np.ndarray:
        """Return (N_L + 1, 3, c), m, world axes: displacement of the nodes by the coordinates.

        In those of `stiffness_matrix`, for shapes as there; the grips at rest.
        """
        return Linearized(self).vibration.jacobian

    def resample(self, n_elements: int) -> 'Shape':
        """Return the same shape on `n_elements` elements of equal length, for pictures and such.

        Nodes lie exactly on this shape's arcs; strains are averaged.
        """
        n = integer('n_elements', n_elements, minimum=1, maximum=1_000_000)
        s = np.linspace(0, self.s[-1], n + 1)
        poses = [self.at(value) for value in s]
        return replace(self, s=s, positions=np.array([pose.position for pose in poses]),
                       frames=np.array([pose.rotation for pose in poses]),
                       element_strains=mapped(self.s, self.element_strains, s),
                       _estimate=Constant(self.error_estimate), _discretization=None,
                       _history=None if self._history is None else self._history.on(s))

    def save(self, path: str | PathLike) -> None:
        """Write the shape as npz, or JSON (see `Plan.save`): all but rod and surroundings."""
        save(path, pack(self), 'Shape')

    @classmethod
    def load(cls, path: str | PathLike) -> 'Shape':
        """Return the Shape saved at `path`; it can start a simulation of the same rod.

        Raises
        ------
        InvalidTask
            Not such a file.
        """
        return load(path, partial(unpack, cls), 'Shape')

    def moved(self, displacement: ArrayLike) -> 'Shape':
        """Return the same shape carried by `displacement` (3,) m: gravity does not notice.

        Obstacles and a far end's grip would: only for shapes that touch nothing.
        """
        displacement = vector('displacement', displacement, 3)
        gripper = Pose.from_rotation(self.gripper.position + displacement, self.gripper.rotation)
        positions = self.positions + displacement
        freeze(positions)
        other = object.__new__(type(self))  # without another look at what is the same
        put(other, **{name: self.__dict__[name] for name in _FIELDS})
        put(other, gripper=gripper, positions=positions,
            energy=self.energy + float(displacement @ self.gripper_wrench[:3]))
        return other

    @property
    def obstacles(self) -> tuple:
        """The obstacles of its simulator; () for a shape from a file."""
        return () if self._discretization is None else self._discretization.surroundings.obstacles


_FIELDS = tuple(item.name for item in fields(Shape))
