"""The answer of the direct simulation: a shape, with its proof."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dlo_planner.direct.history import mapped
from dlo_planner.direct.storage import load, pack, save, unpack
from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import integer, number
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose
from dlo_planner.ritz.kinematics import point_inside


@dataclass(frozen=True, eq=False)
class Shape:
    """A static shape of a DLO held by a gripper; N_L elements, N_L + 1 nodes, world frame, SI.

    Its arrays are shared with whatever was computed from it: copy one before changing it.

    Attributes:
        gripper: the pose for which it was computed
        s: (N_L + 1,) arc lengths of the nodes, m, 0 at the gripper
        positions: (N_L + 1, 3) m
        frames: (N_L + 1, 3, 3) columns are tangent t, normals n and b (the material frame)
        element_strains: (N_L, 3) torsion, curvature about n, about b; 1/m, constant per element
        energy: total potential, J, gravity's zero at the world's origin
        elastic_energy: the part of it that is stored in the DLO, J
        gripper_wrench: (6,) force (N) and moment about the gripper's origin (N m) that the
            gripper exerts on the DLO, world axes
        residual: size of the gradient of the potential, relative to the elastic energy and that
            of a 1 rad bend; did the minimiser finish?
        stability: smallest eigenvalue of the Hessian relative to the elastic one; > 0 a minimum,
            0 neutral (the shape is one of many), < 0 not stable
        iterations: Newton steps; evaluations: of the potential, where the method counts them
        converged: the residual is below 1e-8, the shape is stable or neutral, no constraint is
            violated by more than 1e-6 of the length, and a requested accuracy was reached
        jumped: the shape is not the continuation of the one it was started from
        contacts: tuple of Contact, by s
        violation: by how much a constraint (contact, far end) is violated, m
        far_end: FarEnd, what holds the far end; None if it is free
        far_wrench: (6,) as gripper_wrench, at the far end, about it
        dissipated: energy lost to plastic deformation so far, J
        parts: the two Shapes of a DLO grasped inside (`GraspedInside`), else None
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
    _estimate: Callable = field(default=lambda: np.nan, repr=False)
    _discretisation: object = field(default=None, repr=False)
    _history: object = field(default=None, repr=False)  # what it leaves to the next step
    _before: object = field(default=None, repr=False)   # what the step began with

    @property
    def tangents(self):
        """(N_L + 1, 3) unit tangents at the nodes."""
        return self.frames[:, :, 0]

    @cached_property
    def strains(self):
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
    def error_estimate(self):
        """Largest distance of a node from the true rod's, m.

        From an embedded solution with every element halved and freed from the series (computed
        when first read; it costs about as much as the solution itself).
        """
        return self._estimate()

    def at(self, s):
        """Return the Pose (x axis = tangent) at arc length `s` in m, on the element's exact arc.

        Raises:
            InvalidTask: s outside [0, L]
        """
        s = number('s', s, minimum=0, maximum=self.s[-1])
        rotation, position = self.frame_at(s)
        return Pose.from_rotation(position, rotation)

    def positions_at(self, s):
        """Return (m, 3) positions in m at arc lengths `s` (m,) in m, as `at`, but quicker.

        Raises:
            InvalidTask: one is outside [0, L]
        """
        s = [number('s', value, minimum=0, maximum=self.s[-1]) for value in np.ravel(s)]
        return np.array([self.frame_at(value)[1] for value in s]).reshape(-1, 3)

    def frame_at(self, s):
        """Return axes (3, 3) and position (3,) at `s` in m within [0, L]: `at` for inner loops."""
        element = min(int(np.searchsorted(self.s, s, side='right')) - 1, self.s.size - 2)
        lengths = self._lengths
        rotation, position = np.empty((3, 3)), np.empty(3)
        point_inside(lengths, self.element_strains, self.frames, self.positions, element,
                     (s - self.s[element]) / lengths[element], rotation, position)
        return rotation, position

    @cached_property
    def _lengths(self):
        return np.diff(self.s)

    @property
    def rod(self):
        """The Rod; None for a shape from a file."""
        return None if self._discretisation is None else self._discretisation.rod

    @property
    def bend_radius(self):
        """(N_L,) radius of curvature of the elements, m; infinite where straight."""
        with np.errstate(divide='ignore'):
            return 1 / np.hypot(self.element_strains[:, 1], self.element_strains[:, 2])

    @property
    def bend_margin(self):
        """How much less than the rod's max_bend_curvature the sharpest bend is, 1/m (< 0: more).

        Infinite without a limit.
        """
        limit = None if self.rod is None else self.rod.max_bend_curvature
        return np.inf if limit is None else float(limit - 1 / self.bend_radius.min())

    @property
    def bent(self):
        """(N_L, 3) strains since the stress-free shape, permanent set included there, 1/m.

        Raises:
            InvalidTask: the shape comes from a file and does not know its rod
        """
        if self._discretisation is None:
            raise InvalidTask('this shape does not know its rod: expected one from a simulator')
        return self.element_strains - self._discretisation.stress_free(self._history)

    @property
    def surface_strain(self):
        """(N_L, 2) largest axial and shear strain at the surface; needs `Rod.section`."""
        return self._section().surface_strain(self.bent)

    @property
    def surface_stress(self):
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

    def resample(self, n_elements):
        """Return the same shape on `n_elements` elements of equal length, for pictures and such.

        Nodes lie exactly on this shape's arcs; strains are averaged.
        """
        n = integer('n_elements', n_elements, minimum=1, maximum=1_000_000)
        s = np.linspace(0, self.s[-1], n + 1)
        poses = [self.at(value) for value in s]
        estimate = self.error_estimate
        return replace(self, s=s, positions=np.array([pose.position for pose in poses]),
                       frames=np.array([pose.rotation for pose in poses]),
                       element_strains=mapped(self.s, self.element_strains, s),
                       _estimate=lambda: estimate, _discretisation=None,
                       _history=None if self._history is None else self._history.on(s))

    def save(self, path):
        """Write the shape as npz: everything but the rod and its surroundings."""
        save(path, pack(self))

    @classmethod
    def load(cls, path):
        """Return the Shape saved at `path`; it can start a simulation of the same rod.

        Raises:
            InvalidTask: not such a file
        """
        return unpack(cls, load(path))

    def moved(self, displacement):
        """Return the same shape carried by `displacement` (3,) m: gravity does not notice.

        Obstacles and a far end's grip would: only for shapes that touch nothing.
        """
        displacement = np.asarray(displacement, dtype=float)
        if displacement.shape != (3,) or not np.isfinite(displacement).all():
            raise InvalidTask(f'displacement = {displacement!r}: expected 3 finite numbers')
        gripper = Pose.from_rotation(self.gripper.position + displacement, self.gripper.rotation)
        return replace(self, gripper=gripper, positions=self.positions + displacement,
                       energy=self.energy + float(displacement @ self.gripper_wrench[:3]))
