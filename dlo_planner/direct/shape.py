"""The answer of the direct simulation: a shape, with its proof."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import number
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
        gripper_wrench: (6,) force (N) and moment about the gripper's origin (N m) that the
            gripper exerts on the DLO, world axes
        residual: size of the gradient of the potential, relative to the elastic energy and that
            of a 1 rad bend; did the minimiser finish?
        stability: smallest eigenvalue of the Hessian relative to the elastic one; > 0 a minimum,
            0 neutral (the shape is one of many), < 0 not stable
        iterations: Newton steps
        converged: the residual is below 1e-8, the shape is stable or neutral, and a requested
            accuracy was reached
        jumped: the shape is not the continuation of the one it was started from
        contacts: none yet; obstacles fill it
    """

    gripper: Pose
    s: np.ndarray
    positions: np.ndarray
    frames: np.ndarray
    element_strains: np.ndarray
    energy: float
    gripper_wrench: np.ndarray
    residual: float
    stability: float
    iterations: int
    converged: bool
    jumped: bool = False
    contacts: tuple = ()
    _estimate: Callable = field(default=lambda: np.nan, repr=False)
    _discretisation: object = field(default=None, repr=False)

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
        element = min(int(np.searchsorted(self.s, s, side='right')) - 1, self.s.size - 2)
        lengths = np.diff(self.s)
        rotation, position = np.empty((3, 3)), np.empty(3)
        point_inside(lengths, self.element_strains, self.frames, self.positions, element,
                     (s - self.s[element]) / lengths[element], rotation, position)
        return Pose.from_rotation(position, rotation)

    def moved(self, displacement):
        """Return the same shape carried by `displacement` (3,) m: gravity does not notice."""
        displacement = np.asarray(displacement, dtype=float)
        if displacement.shape != (3,) or not np.isfinite(displacement).all():
            raise InvalidTask(f'displacement = {displacement!r}: expected 3 finite numbers')
        gripper = Pose(self.gripper.position + displacement, self.gripper.quaternion)
        return replace(self, gripper=gripper, positions=self.positions + displacement,
                       energy=self.energy + float(displacement @ self.gripper_wrench[:3]))
