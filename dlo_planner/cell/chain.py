# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO as a chain of rigid pieces that are joined by springs.

The DLO is cut into cells of equal length. A joint in the middle of each cell bends and twists as
much as the whole cell does, so the first joint is half a cell from the gripper. The direction of a
piece is the tangent of the DLO at its middle; positions and tangents there have an error of second
order in the length of a cell. Each joint has three hinges, about n, t, b or about b, t, n in turn:
the torsion due to the order of rotations cancels between neighbors.

Hinges about n and b are softer where both bend. By angles a and c, with a torsion by tau, the
tangent turns by theta, to fourth order theta^2 = a^2 + c^2 - a^2 c^2 / 3 - 2 a c tau. So the least
energy of a bend at an angle phi from n is EI theta^2 (1 + x theta^2 sin(2 phi)^2) / 2 per length
of a cell, x = (1/3 - EI / GJ) / 4. That is little, but a round DLO that is bent over turns easily
about its axis: a soft wire hung 3.6 mm aside. Where a section bends alike about all axes, the
hinges of half of the joints are therefore turned by 45 degrees about t, which leaves x / 2 at any
phi, and a small part of the springs is cubic, by which the mean is 0.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.cell.truth import Truth
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.rod import Rod

try:
    import mujoco
except ImportError as error:
    raise ImportError('dlo_planner.cell needs MuJoCo: pip install dlo_planner[cell]') from error

if not hasattr(mujoco.mjtIntegrator, 'mjINT_DISCRETE'):
    raise ImportError(f'dlo_planner.cell needs mujoco >= 3.13, this is {mujoco.__version__}: its '
                      'older integrators do not take stiff springs into account in contacts')

# It would write a file wherever it is; the plant sees by itself what goes wrong.
mujoco.set_mju_user_warning(lambda message: None)

__all__ = ['DLO', 'SCENE', 'Chain', 'add_chain', 'add_far_grip', 'add_grip', 'add_gripper',
           'chain_of', 'mujoco', 'place_in', 'set_rest', 'set_springs']

_GAUSS = np.polynomial.legendre.leggauss(5)
_ORDERS = (1, 0, 2), (2, 0, 1)  # axes of the hinges in the order of the strains
# rad, of one joint's hinges after the other about t: half of them on the mean, to second order
# along the DLO, and those that are turned alike in both orders
_TURNED = 0.0, np.radians(45), np.radians(45), 0.0
_SOLID = 1.5    # largest EI / GJ = 1 + nu of a solid: what twists more easily leaves fourth order
_THIN = 1e-4    # of mass times length^2 of a piece: the least inertia about its axis, to be above 0
_HEAVY = 1e6    # mass of the gripper over that of the DLO, which then does not move it
_LEVER = 30.0   # lengths: a hand's hold of a turn, by the engine's own rule, yields to the springs
DLO, SCENE = 1, 2  # bits of what collides with what


@dataclass(frozen=True)
class Chain:
    """The properties of a chain of n cells; the gripper holds the first half of the first cell.

    Masses, inertias, stiffness and forces of the model are divided by `unit`, the mass of the DLO
    in kg: the engine takes no mass and no inertia below 1e-15, which those of a thin thread would
    be in kg. A force of the model times `unit` is in N.
    """

    length: float  # length in m
    unit: float  # unit of mass, kg
    stiffness: Floats  # (n, 3) N m per rad over `unit` of each joint, torsion, about n, about b
    rest: Floats  # (n, 3) rest in rad, the angles of each joint without stress
    masses: Floats  # (n,) masses over `unit`, of the pieces
    centers: Floats  # (n,) centers in m, of their masses, from the joint before each
    inertias: Floats  # (n, 3) inertias in m^2, over `unit`, about the center, along t, n, b
    radii: Floats  # (n,) radii in m
    # half sizes along n and b of a rectangular section, m. If None, round
    box: tuple[float, float] | None

    @property
    def cell(self) -> float:
        """Length of a cell, m."""
        return self.length / len(self.masses)

    @property
    def even(self) -> Bools:
        """Which sections (n,) bend alike about all axes, as round ones do."""
        alike: Bools = self.stiffness[:, 1] == self.stiffness[:, 2]
        return alike

    @property
    def axes(self) -> Floats:
        """Axes (n, 3, 3) of the hinges of each joint in its piece: torsion, about n, about b."""
        turned = np.where(self.even, np.resize(_TURNED, len(self.masses)), 0.0)
        axes: Floats = Rotation.from_euler('x', turned[:, None]).as_matrix().transpose(0, 2, 1)
        return axes

    @property
    def cubic(self) -> Floats:
        """The part (n, 3) of the moment with the angle's third power, N m / rad^3 over `unit`."""
        ratio = np.minimum(self.stiffness[:, 1] / self.stiffness[:, 0], _SOLID)
        # energy EI y (a^4 + c^4) / 2, on the mean of both turns EI y 3/4 theta^4 / 2: y = -2 x / 3
        part = np.where(self.even, (ratio - 1 / 3) / 6, 0.0)
        cubic: Floats = 2 * part[:, None] * self.stiffness * (0, 1, 1)
        return cubic

    @property
    def slowness(self) -> float:
        """sqrt(m L^3 / EI), s: the slowest vibration of a straight DLO goes on by 3.5 rad in it."""
        softest = self.stiffness[:, 1:].min() * self.cell
        return float(np.sqrt(self.masses.sum() * self.length**3 / softest))


def chain_of(rod: Rod, truth: Truth, cells: int) -> Chain:
    """Return the Chain of a Rod with the properties of a Truth."""
    length = truth.length_of(rod)
    cell = length / cells
    edges = np.linspace(0, length, cells + 1)
    places = 0.5 * (1 + _GAUSS[0]) * cell
    inside = (edges[:-1, None] + places).ravel()
    stiffness = 1 / _means(1 / truth.stiffnesses(rod, inside), cells)
    joints = 0.5 * (edges[:-1] + edges[1:])
    ends = np.append(joints[1:], length)
    masses, centers, inertias = _masses(rod, truth, joints, ends)
    section = rod.section
    box = None
    if section is not None and section.kind == 'rectangular':
        box = section.half_n, section.half_b
    unit = masses.sum()
    return Chain(length, unit, stiffness / (cell * unit),
                 _means(truth.natural_strains(rod, inside), cells) * cell,
                 masses / unit, centers, inertias / unit,
                 rod.radii(np.minimum(0.5 * (joints + ends), rod.length)),
                 box)


def _means(values: Floats, cells: int) -> Floats:
    """Return the means (cells, k) of values at Gauss points (cells * 5, k)."""
    weights = 0.5 * _GAUSS[1]
    means: Floats = np.einsum('cgk,g->ck', values.reshape(cells, weights.size, -1), weights)
    return means


def _masses(rod: Rod, truth: Truth, joints: Floats, ends: Floats) -> tuple[Floats, Floats, Floats]:
    """Return masses (n,), centers (n,) from the joint, inertias (n, 3) of the pieces."""
    points = [(min(s, ends[-1]), truth.mass * m) for s, m in rod.point_masses]
    points.append((ends[-1], truth.mass * rod.tip_mass))
    found = []
    for k, (begin, end) in enumerate(zip(joints, ends, strict=True)):
        s = begin + 0.5 * (end - begin) * (1 + _GAUSS[0])
        lumps = 0.5 * (end - begin) * _GAUSS[1] * truth.masses_per_length(rod, s)
        last = k == len(joints) - 1
        for at, mass in points:
            if begin <= at and (at < end or last):
                s, lumps = np.append(s, at), np.append(lumps, mass)
        mass = lumps.sum()
        center = s @ lumps / mass
        along = lumps @ (s - center) ** 2
        across = 0.25 * mass * rod.radii(np.array([min(center, rod.length)]))[0] ** 2
        across = max(across, _THIN * mass * (end - begin) ** 2)
        found.append((mass, center - begin, (2 * across, along + across, along + across)))
    masses, centers, inertias = map(np.array, zip(*found, strict=True))
    return masses, centers, inertias


def add_gripper(spec: mujoco.MjSpec, chain: Chain) -> mujoco.MjsBody:
    """Add the gripper to an MjSpec and return it; it is so heavy that the DLO does not move it.

    The part of the DLO inside it touches nothing: it could not give way to an obstacle.
    """
    gripper = spec.worldbody.add_body(name='gripper', gravcomp=1)
    mass = _HEAVY * chain.masses.sum()
    gripper.explicitinertial = True
    gripper.mass, gripper.inertia = mass, np.full(3, mass * chain.length**2)
    gripper.add_freejoint()
    return gripper


def add_chain(gripper: mujoco.MjsBody, chain: Chain) -> None:
    """Add the pieces of a Chain to a gripper of MjSpec."""
    parent, at, axes = gripper, 0.5 * chain.cell, chain.axes
    for k in range(len(chain.masses)):
        piece = parent.add_body(name=f'piece {k}', pos=(at, 0, 0))
        piece.explicitinertial = True
        piece.mass, piece.inertia = chain.masses[k], chain.inertias[k]
        piece.ipos = (chain.centers[k], 0, 0)
        for axis in _ORDERS[k % len(_ORDERS)]:
            piece.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=axes[k, axis])
        last = k == len(chain.masses) - 1
        _add_geom(piece, chain, k, (0.5 if last else 1) * chain.cell)
        parent, at = piece, chain.cell


def add_far_grip(spec: mujoco.MjSpec, chain: Chain, grip: str) -> None:
    """Add what may hold the free end, a body that is placed; it does not hold as yet."""
    spec.worldbody.add_body(name='far grip', mocap=True).add_site(name='grip')
    spec.body(f'piece {len(chain.masses) - 1}').add_site(name='end', pos=(0.5 * chain.cell, 0, 0))
    kind = mujoco.mjtEq.mjEQ_WELD if grip == 'clamped' else mujoco.mjtEq.mjEQ_CONNECT
    held = spec.add_equality(type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, name1='end',
                             name2='grip', active=False)
    if grip == 'clamped':
        held.data[10] = chain.length  # a rad counts as so many m


def place_in(chain: Chain, s: float) -> tuple[int, float]:
    """Return the piece in which the place `s` (m) of the DLO is, and where in it, m."""
    piece = int(np.clip(np.floor(s / chain.cell - 0.5), 0, len(chain.masses) - 1))
    return piece, s - (piece + 0.5) * chain.cell


def add_grip(spec: mujoco.MjSpec, chain: Chain, number: int, s: float,
             grip: str = 'clamped') -> None:
    """Add a hand, by its number, that may clamp or pin the place `s` (m) of the DLO, in a piece.

    It is a body that is placed, and does not hold as yet. A piece has the direction of its middle:
    places there, at a multiple of a cell, are held most exactly.
    """
    piece, off = place_in(chain, s)
    spec.worldbody.add_body(name=f'hand {number}', mocap=True).add_site(name=f'hand {number}')
    spec.body(f'piece {piece}').add_site(
        name=f'held {number}', pos=(off, 0, 0))
    kind = mujoco.mjtEq.mjEQ_WELD if grip == 'clamped' else mujoco.mjtEq.mjEQ_CONNECT
    held = spec.add_equality(type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE,
                             name1=f'held {number}', name2=f'hand {number}', active=False)
    if grip == 'clamped':
        held.data[10] = _LEVER * chain.length  # a rad counts as so many m


def set_springs(model: mujoco.MjModel, chain: Chain) -> Floats:
    """Set the stiffness and rest angles of an MjModel's joints; return the stiffness (3 n,)."""
    stiffness = _by_hinge(chain.stiffness)
    model.jnt_stiffness[1:], model.jnt_stiffnesspoly[1:, 1] = stiffness, _by_hinge(chain.cubic)
    set_rest(model, chain, chain.rest)
    # The solver's tolerance is relative to the mean inertia: here without that of the gripper.
    model.stat.meaninertia = chain.masses.mean() * chain.length**2 / 3
    return stiffness


def set_rest(model: mujoco.MjModel, chain: Chain, angles: Floats) -> None:
    """Set the rest angles (n, 3), rad, of an MjModel's joints: torsion, about n, about b."""
    model.qpos_spring[7:] = _by_hinge(np.einsum('kij,kj->ki', chain.axes, angles))


def _by_hinge(values: Floats) -> Floats:
    """Return values (n, 3) of torsion and of bending about two axes as the hinges (3 n,) are."""
    orders = np.array([_ORDERS[k % len(_ORDERS)] for k in range(len(values))])
    return np.take_along_axis(values, orders, axis=1).ravel()


def _add_geom(body: Any, chain: Chain, k: int, length: float) -> None:
    """Add the outside of a piece of a length in m to its body."""
    half = 0.5 * length
    if chain.box is None:
        if not chain.radii[k]:
            return  # a thin line touches nothing
        shape, size = mujoco.mjtGeom.mjGEOM_CAPSULE, (chain.radii[k], half, 0.0)
        turn = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)  # its axis from z to x
    else:
        shape, size, turn = mujoco.mjtGeom.mjGEOM_BOX, (half, *chain.box), (1.0, 0.0, 0.0, 0.0)
    # The engine takes the larger friction of the two that touch: it is the obstacle's alone.
    body.add_geom(type=shape, size=size, quat=turn, pos=(half, 0, 0), contype=DLO,
                  conaffinity=SCENE, condim=1, friction=(0, 0, 0))
