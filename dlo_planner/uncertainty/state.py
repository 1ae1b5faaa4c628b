# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The state of an estimate: what is not known of a DLO, its gripper and a camera, with its prior.

Its numbers are 0 where all is as stated; `PointSlopes` say how points of an equilibrium move with
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.sensitivity import HangingSensitivities, Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.geometry.kinematics import points_inside
from dlo_planner.geometry.so3 import left_jacobian
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Value, put
from dlo_planner.uncertainty.parameters import (
    ParameterizedMesh,
    RodParameters,
    Uncertainty,
    elements_at,
    moved_points,
    moved_points_of,
    variation_deviations,
)

CALIBRATION = 'camera', 'camera_rotation'  # numbers of what is wrong with that of a camera
CAMERA = *CALIBRATION, 'stamps'
NOT_OF_ROD = 'gripper_rotation', 'gripper_position', *CAMERA, 'cutout'
_KEPT = 8     # meshes that are remembered
_SAME = 1e-9  # of the length: nodes closer than this are the same


class UncertainState(Value):
    """The n numbers z of an estimate's state, with a normal prior: the rod, the gripper, a camera.

    First those of `RodParameters`, then, all 0 where it is as stated:

        gripper_rotation, gripper_position             rad and m, in the gripper's frame
        camera                                         m, world axes: seen minus true
        camera_rotation                                rad, world axes: of what is seen, about
                                                       the reference point of `CameraError`
        stamps                                         s: by how much stamps of looks are too late
        cutout                                         m, world axes: true minus stated

    Only numbers with a standard deviation above 0 are in it. Shapes show only the ratio of
    stiffness to weight; the priors divide it between both.
    """

    _PARTS = ('simulator', 'uncertainty', 'n_terms', 'bias', 'cutout', 'camera_rotation', 'stamps')

    simulator: DirectSimulator  # of the DLO as stated, elastic, without obstacles
    uncertainty: Uncertainty
    n_terms: int   # Legendre terms of each natural curvature
    bias: float    # standard deviations of the camera's bias and of the cut-out's place, m
    cutout: float
    camera_rotation: float  # standard deviations about each axis, rad, and of the delay, s
    stamps: float
    parameters: RodParameters
    deviations: Floats  # (n,) of the prior, all > 0
    names: tuple[str, ...]
    causes: tuple[str, ...]  # names in Uncertainty of what each number is part of
    _columns: dict[str, tuple[Ints, Ints]]
    _meshes: list[ParameterizedMesh]

    def __init__(self, simulator: DirectSimulator, uncertainty: Uncertainty, n_terms: int,
                 bias: float = 0.0, cutout: float = 0.0, camera_rotation: float = 0.0,
                 stamps: float = 0.0) -> None:
        put(self, simulator=simulator, uncertainty=uncertainty, n_terms=n_terms, bias=bias,
            cutout=cutout, camera_rotation=camera_rotation, stamps=stamps)
        terms = np.append(uncertainty.natural_curvature,
                          uncertainty.curvature_variation * variation_deviations(n_terms - 1))
        prior: dict[str, Sequence[float] | Floats] = {
            **{name: [getattr(uncertainty, name)] for name in (
                'bending_stiffness', 'torsional_stiffness', 'mass', 'mass_gradient', 'length')},
            'natural_curvature': np.repeat(terms, 2),
            'gripper_rotation': [uncertainty.gripper_rotation] * 3,
            'gripper_position': [uncertainty.gripper_position] * 3,
            'camera': [bias] * 3, 'camera_rotation': [camera_rotation] * 3,
            'stamps': [stamps], 'cutout': [cutout] * 3}
        entries = [(name, k, deviation) for name, deviations in prior.items()
                   for k, deviation in enumerate(deviations) if deviation > 0]
        each = np.array([name for name, _, _ in entries])
        number_ = np.array([k for _, k, _ in entries], dtype=int)
        of_rod = [(name, k) for name, k, _ in entries
                  if name not in NOT_OF_ROD]
        put(self, parameters=RodParameters(simulator.rod, (name for name, _ in of_rod),
                                           (k for _, k in of_rod)),
            deviations=np.array([deviation for *_, deviation in entries]), _meshes=[],
            names=tuple(f'{name}[{k}]' if len(prior[name]) > 1 else name
                        for name, k, _ in entries),
            causes=tuple('curvature_variation' if name == 'natural_curvature' and k > 1 else name
                         for name, k, _ in entries),
            _columns={name: (np.flatnonzero(each == name), number_[each == name])
                      for name in prior})
        super().__post_init__()

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, name) for name in self._PARTS)

    @property
    def size(self) -> int:
        """The number n of entries of the state."""
        return self.deviations.size

    def columns(self, name: str) -> tuple[Ints, Ints]:
        """Return indices (k,) in the state, and (k,) in the quantity `name`, of its k numbers."""
        return self._columns[name]

    def rod(self, z: Floats) -> Rod:
        """Return the Rod at z (n,)."""
        return self.parameters.at(z[:self.parameters.size])

    def mesh(self, like: Discretization) -> ParameterizedMesh:
        """Return the ParameterizedMesh with the elements of a mesh, scaled to the stated length."""
        length = self.simulator.rod.length
        s = np.append(like.s[:-1] * (length / like.s[-1]), length)
        for known in self._meshes:
            mesh = known.mesh
            if mesh.basis == like.basis and mesh.s.size == s.size and (
                    np.abs(mesh.s - s).max() <= _SAME * length):
                return known
        if len(self._meshes) == _KEPT:
            self._meshes.pop(0)
        self._meshes.append(ParameterizedMesh(self.parameters, Discretization(
            self.simulator.surroundings, s, like.basis, like.n_terms)))
        return self._meshes[-1]

    def equilibrium(self, z: Floats, like: Discretization, gripper: Pose,
                    before: Shape | None = None, followed: bool = True) -> Shape:
        """Return the Shape at z on a mesh like another; see `ParameterizedMesh.equilibrium`."""
        return self.mesh(like).equilibrium(z[:self.parameters.size], gripper, before, followed)

    def draw(self, rng: np.random.Generator, count: int) -> Floats:
        """Return (count, n) states that the prior stands for."""
        return rng.normal(size=(count, self.size)) * self.deviations

    def _part(self, z: Floats, name: str) -> Floats:
        """Return the numbers (3,) of one quantity; 0 for those that are not in the state."""
        out = np.zeros(3)
        where, which = self.columns(name)
        out[which] = z[where]
        return out

    def _gripper_twist(self, z: Floats, error: Floats | None) -> Floats:
        twist = np.append(self._part(z, 'gripper_rotation'), self._part(z, 'gripper_position'))
        return twist if error is None else twist + error

    def offset(self, z: Floats, error: Floats | None = None) -> Pose:
        """Return the true Pose in the measured one's frame, with a robot's `error` (6,)."""
        twist = self._gripper_twist(z, error)
        return Pose.from_rotation(twist[3:], Rotation.from_rotvec(twist[:3]).as_matrix())

    def camera(self, z: Floats, reference: Floats) -> CameraError:
        """Return the CameraError at z (n,), with a rotation about a `reference` (3,), m."""
        return CameraError(self._part(z, 'camera'), self._part(z, 'camera_rotation'), reference)

    def delay(self, z: Floats) -> float:
        """Return by how much stamps of looks are too late, s."""
        return float(self._part(z, 'stamps')[0])

    def shifted(self, z: Floats) -> Floats:
        """Return (3,) the displacement of the cut-out, true minus stated, m, world axes."""
        return self._part(z, 'cutout')

    def slopes(self, z: Floats, shape: Shape, error: Floats | None = None) -> PointSlopes:
        """Return the slopes by z of the equilibrium at z; by the robot's `error` (6,) if given."""
        sensitivity, n = Sensitivity(shape), self.size
        mesh, x = self.mesh(shape.state.made_on), z[:self.parameters.size]
        robot = np.arange(3 if error is not None else 0)
        frame = shape.gripper.rotation @ self.offset(z, error).rotation.T
        (turned, turns), (placed, places) = (
            (np.append(self.columns(name)[0], first + robot),
             np.append(self.columns(name)[1], robot))
            for name, first in (('gripper_rotation', n), ('gripper_position', n + 3)))
        about = (frame @ left_jacobian(self._gripper_twist(z, error)[:3]))[:, turns]
        strains = np.zeros((n + 2 * robot.size, *shape.element_strains.shape))
        stretch = np.zeros(strains.shape[:2])
        strains[:x.size], stretch[:x.size] = mesh.strain_slopes(x, shape, sensitivity)
        strains[turned] = np.moveaxis(sensitivity.strains[:, :, :3] @ about, 2, 0)
        if shape.contacts:  # else its shape stays
            strains[placed] = np.moveaxis(sensitivity.strains[:, :, 3:] @ frame[:, places], 2, 0)
        bent = np.flatnonzero(strains.any(axis=(1, 2)) | stretch.any(axis=1))
        return PointSlopes(shape, len(strains), bent, strains[bent], stretch[bent], turned, about,
                           placed, frame[:, places])

    def moved(self, shapes: Sequence[Shape], s: Floats) -> tuple[Floats, Floats]:
        """Return how points of n Shapes, the DLO being as stated, move with z: (n, m, 3, k).

        They are at arc lengths s (m,), m; then the tangents there (n, m, 3). World axes.
        """
        stated, mesh = np.zeros(self.size), HangingSensitivities.mesh_of(shapes)
        if mesh is None:
            slopes = np.array([self.slopes(stated, shape)(s) for shape in shapes])
            return slopes, np.array([[shape.frame_at(one)[0][:, 0] for one in s.tolist()]
                                     for shape in shapes])
        many, x = HangingSensitivities(mesh, shapes), stated[:self.parameters.size]
        changes, stretch, by_turns = self.mesh(mesh).strain_slopes_of(x, many)
        turned, turns = self.columns('gripper_rotation')
        placed, places = self.columns('gripper_position')
        about, along = many.grippers[:, :, turns], many.grippers[:, :, places]
        strains = np.concatenate([changes, np.einsum('jaei,jak->jkei', by_turns, about)], axis=1)
        lengths, (elements, fractions) = np.diff(mesh.s), elements_at(
            mesh.s, np.minimum(s, mesh.s[-1]))
        frames, positions = (np.array([getattr(shape, name) for shape in shapes])
                             for name in ('frames', 'positions'))
        moved = moved_points_of(lengths, many.strains, frames, elements, fractions, strains,
                                np.concatenate([stretch, np.zeros((turned.size, lengths.size))]))
        axes, points = points_inside(lengths, many.strains, frames, positions, elements, fractions)
        arms = points - positions[:, :1]
        out = np.zeros((len(shapes), s.size, 3, self.size))
        out[..., :x.size] = moved[..., :x.size]
        out[..., turned] = moved[..., x.size:] + np.cross(
            about[:, None], arms[..., None], axis=2)
        out[..., placed] += along[:, None]
        return out, axes[..., 0]


class CameraError(NamedTuple):
    """Where a camera sees a point: rotated about a reference point, then displaced, world axes.

    What is left of a hand-eye calibration. Its rotation is about the camera; about any other point
    it is the same but for a displacement, so the reference stands among what is looked at, where a
    displacement and a rotation are about independent.
    """

    bias: Floats       # (3,) m
    rotation: Floats   # (3,) rotation vector, rad
    reference: Floats  # (3,) m

    def undone(self, points: Floats) -> Floats:
        """Return the true places (m, 3) of points (m, 3) that are seen."""
        if not self.rotation.any():
            return points - self.bias
        turn = Rotation.from_rotvec(self.rotation).as_matrix()
        places: Floats = (points - self.bias - self.reference) @ turn + self.reference
        return places

    def slopes(self, places: Floats) -> Floats:
        """Return (m, 3, 3) the derivatives of seen points by the rotation, of places (m, 3)."""
        return turning(places - self.reference)


def turning(arms: Floats) -> Floats:
    """Return (m, 3, 3) the derivatives of arms (m, 3) by a small rotation vector."""
    result: Floats = -np.cross(arms[:, :, None], np.eye(3)[None], axis=1)
    return result


class PointSlopes(NamedTuple):
    """The derivatives of the points of a Shape by n numbers: a function of s."""

    shape: Shape
    size: int        # n
    bent: Ints       # (b,) numbers that change its shape:
    strains: Floats  # (b, N, 3) its strains by them, 1/m, and
    stretch: Floats  # (b, N) its elements' lengths, in parts of them
    turned: Ints     # (t,) numbers that turn it with the gripper:
    about: Floats    # (3, t) about what, world axes
    placed: Ints     # (p,) numbers that displace it:
    along: Floats    # (3, p) along what

    def __call__(self, s: Floats) -> Floats:
        """Return (m, 3, n) the derivatives at arc lengths s (m,), at most the end; world axes."""
        s = np.minimum(s, self.shape.s[-1])
        out = np.zeros((s.size, 3, self.size))
        out[:, :, self.bent] = moved_points(self.shape, s, self.strains, self.stretch)
        arms = self.shape.positions_at(s) - self.shape.gripper.position
        out[:, :, self.turned] += np.cross(self.about.T[None], arms[:, None]).transpose(0, 2, 1)
        out[:, :, self.placed] += self.along
        return out


def slopes_by_gripper(shape: Shape) -> PointSlopes:
    """Return the slopes by the gripper's twist: rotation vector, rad, and way, m, world axes.

    Those of a DLO that hangs freely in equilibrium: it goes along with its gripper as far as its
    stiffness leads it, a soft one hangs down as before where a rigid body would turn.
    """
    strains = np.moveaxis(Sensitivity(shape).strains[:, :, :3], 2, 0)
    return PointSlopes(shape, 6, np.arange(3), strains, np.zeros(strains.shape[:2]), np.arange(3),
                       np.eye(3), np.arange(3, 6), np.eye(3))


def stretched(shape: Shape, length: float) -> Shape:
    """Return a Shape on a mesh of another length, to start from."""
    share = length / shape.s[-1]
    return replace(shape, s=np.append(shape.s[:-1] * share, length),
                   state=shape.state.forgotten())
