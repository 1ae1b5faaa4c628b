# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The answer of the direct simulation: a shape, with its proof."""

from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cached_property, partial
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.contacts import Contact
from dlo_planner.direct.mesh import mapped
from dlo_planner.direct.of_dlo import OfDLO
from dlo_planner.direct.permanent_set import hinge
from dlo_planner.direct.state import UNKNOWN, State
from dlo_planner.direct.storage import load, pack, save, unpack
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, flag, instance, integer, items, row, shown, vector
from dlo_planner.model.computed import figure
from dlo_planner.model.far_end import FarEnd, distance, within_reach
from dlo_planner.model.pose import Pose, shifted
from dlo_planner.model.value import brief, owned, put

_NEARLY, _STABLE, _KEPT = 1e-4, 1e-3, 1e-6  # what a shape is not to exceed to go on from it


@dataclass(frozen=True, eq=False, repr=False)
class Shape(OfDLO):
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
        By how much a constraint (contact, far end) is violated, m; how deep the gripper itself, a
        point, is in an obstacle is part of it.
    far_end : FarEnd or None
        What holds the far end; None if it is free.
    far_wrench : ndarray, shape (6,)
        As `gripper_wrench`, at the far end, moment about it.
    dissipated : float
        Energy lost to plastic deformation so far, J.
    parts : tuple or None
        The two Shapes of a DLO grasped inside (`GraspedInside`), else None.
    state : State
        What it leaves to the next step, besides what is listed above; opaque.
    """

    gripper: Pose
    s: Floats
    positions: Floats
    frames: Floats
    element_strains: Floats
    energy: float
    elastic_energy: float
    gripper_wrench: Floats
    residual: float
    stability: float
    iterations: int
    converged: bool
    jumped: bool = False
    contacts: tuple[Contact, ...] = ()
    evaluations: int = 0
    violation: float = 0.0
    far_end: FarEnd | None = None
    far_wrench: Floats = field(default_factory=lambda: np.zeros(6))
    dissipated: float = 0.0
    parts: 'tuple[Shape, ...] | None' = None
    state: State = field(default=UNKNOWN, metadata={'opaque': True})

    REMEMBERED = ('error_estimate',)

    def __post_init__(self) -> None:
        if getattr(self.state, 'mesh', None) is None:  # else a simulator made it
            self._judge()
        put(self, **{name: owned(getattr(self, name)) for name in ('s', *_ARRAYS)})

    def _judge(self) -> None:
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
        instance('Shape.state', self.state, State)
        if self.parts is not None:
            put(self, parts=items('Shape.parts', self.parts, Shape, least=2))

    def __repr__(self) -> str:
        mesh = self.state.mesh
        cheap = not (self.contacts or self.far_end or mesh is None or mesh.stores)
        known = cheap or 'error_estimate' in self.__dict__
        return brief(self, f'{self.s[-1]:.4g} m', f'{len(self.element_strains)} elements',
                     'converged' if self.converged else 'not converged',
                     'jumped' if self.jumped else '', f'residual {self.residual:.1g}',
                     f'stability {self.stability:.2g}',
                     f'error {self.error_estimate:.1g} m' if known else '',
                     f'{len(self.contacts)} contacts' if self.contacts else '',
                     'lies in itself' if self.lies_in_itself else '')

    @property
    def nearly(self) -> bool:
        """Whether it is not `converged`, but good enough to go on from (`DirectSimulator.track`).

        It is stable, keeps all constraints, and its residual is below 1e-4.
        """
        return bool(not self.converged and not self.jumped and self.hinge is None
                    and self.residual < _NEARLY
                    and self.stability > -_STABLE and self.violation <= _KEPT * self.s[-1]
                    and self._within_reach)

    @property
    def status(self) -> str:
        """How the computation ended, in words: 'converged', 'nearly converged', or why not.

        With 'jumped', 'lies in itself' and 'plastic hinge' where it did, does and has one.
        """
        if self.far_end is not None and not self._within_reach:
            return (f'out of reach: the far end is held {distance(self.far_end, self.gripper):.9g} '
                    f'm from the gripper, the DLO is {self.s[-1]:.9g} m long')
        figures = (f'residual {self.residual:.2g}, stability {self.stability:.2g}, '
                   f'violation {self.violation:.2g} m')
        if self.converged:
            return ('converged' + (', jumped' if self.jumped else '')
                    + (', lies in itself' if self.lies_in_itself else '')
                    + (f', {self._hinge_in_words}' if self.hinge is not None else ''))
        if self.hinge is not None:
            return f'not converged: {self._hinge_in_words}'
        if self.nearly:
            return f'nearly converged: {figures}'
        return f'not converged{", jumped" if self.jumped else ""}: {figures}'

    @property
    def hinge(self) -> float | None:
        """Arc length in m of a plastic hinge, one element that bends alone; None if there is none.

        Without `Rod.hardening` a moment beyond what the section bears bends one element, the
        sharper the shorter it is: strains there mean nothing. With an accuracy that is no
        `converged` shape, on elements of a given number `error_estimate` tells what it does.
        """
        found = self._hinge
        return None if found is None else float(0.5 * self.s[found[0]:found[0] + 2].sum())

    @property
    def _hinge(self) -> tuple[int, float] | None:
        mesh = self.state.mesh
        return None if mesh is None else hinge(mesh.rod, self.element_strains - mesh.natural)

    @property
    def _hinge_in_words(self) -> str:
        assert self._hinge is not None  # asked for where there is one
        return (f'plastic hinge at s = {self.hinge:.4g} m, one element is strained '
                f'{self._hinge[1]:.3g} times its yield limit, a shorter one would be further: '
                'more moment than the section bears without hardening (Rod.hardening)')

    @property
    def _within_reach(self) -> bool:
        loaded = self.state.mesh is None or self.state.mesh.loaded
        return within_reach(self.far_end, self.gripper, float(self.s[-1]), loaded)

    @cached_property
    def error_estimate(self) -> float:
        """Largest distance of a node from the true rod's, m.

        From an embedded solution with every element halved and freed from the series (computed
        when first read; it costs about as much as the solution itself).
        """
        return self.state.estimate()

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
                       state=self.state.resampled(s, self.error_estimate))

    def save(self, path: str | PathLike[str]) -> None:
        """Write the shape as npz, or JSON (see `Plan.save`): all but rod and surroundings."""
        save(path, pack(self), 'Shape')

    @classmethod
    def load(cls, path: str | PathLike[str]) -> 'Shape':
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
        return carried(self, vector('displacement', displacement, 3))


def carried(shape: Shape, displacement: Floats) -> Shape:
    """Return what `Shape.moved` does, of an array (3,): quicker, nothing is judged."""
    gripper = shifted(shape.gripper, displacement)
    positions = shape.positions + displacement
    positions.flags.writeable = False
    other = object.__new__(type(shape))  # without another look at what is the same
    contents = shape.__dict__.copy()
    if len(contents) > len(_FIELDS):
        for name in contents.keys() - _FIELDS:  # what was computed from it since
            del contents[name]
    contents.update(gripper=gripper, positions=positions, energy=shape.energy + float(
        displacement @ shape.gripper_wrench[:3]))
    object.__setattr__(other, '__dict__', contents)
    return other


_FIELDS = frozenset(item.name for item in fields(Shape))
_DEFAULTS = {item.name: item.default for item in fields(Shape) if item.default is not MISSING}
_ARRAYS = ('positions', 'frames', 'element_strains', 'gripper_wrench', 'far_wrench')


def made_shape(**contents: Any) -> Shape:
    """Return the Shape that a simulator makes, of new arrays: quicker, nothing is judged.

    Parameters
    ----------
    contents : object
        Fields; those without a default are all there.
    """
    shape = object.__new__(Shape)
    object.__setattr__(shape, '__dict__', _DEFAULTS | contents)
    for name in _ARRAYS:
        contents[name].flags.writeable = False
    return shape
