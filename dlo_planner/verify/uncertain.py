# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is uncertain about a DLO, its gripper and a camera: names, priors, and their effect.

The state is an array z, 0 where all is as stated. Each number has a normal prior:

    bending_stiffness, torsional_stiffness, mass   logarithms of factors
    length                                         m
    natural_curvature                              1/m, Legendre terms along s of k_n and k_b
    gripper_rotation, gripper_position             rad and m, in the gripper's frame
    camera                                         m, world axes: seen minus true
    cutout                                         m, world axes: true minus stated

Only numbers with a standard deviation above 0 are in it. Shapes show only the ratio of stiffness to
weight; the priors divide it between both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.polynomial.legendre import legint, legval
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.energy.loads import node_masses
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, of_length
from dlo_planner.model.value import Value, put
from dlo_planner.model.varying import Expanded, scaled
from dlo_planner.verify.uncertainty import Uncertainty, variation_deviations

_KEPT = 8     # meshes whose Varied is remembered
_SAME = 1e-9  # of the length: nodes closer than this are the same
_PART = 1e-4  # of the length: step of the difference quotients by the length


class Uncertain(Value):
    """The n numbers of an estimate's state: which they are, and what they change.

    Parameters
    ----------
    simulator : DirectSimulator
        DirectSimulator of the DLO as stated, elastic, without obstacles.
    uncertainty : Uncertainty
        Standard deviations of the DLO and of the gripper's pose.
    n_terms : int
        Legendre terms of each natural curvature.
    bias, cutout : float
        Standard deviations of the camera's bias and of the cut-out's place, m.

    Attributes
    ----------
    deviations : ndarray, shape (n,)
        Prior standard deviations, all > 0.
    names : tuple of str
        Names of the n numbers.
    """

    _PARTS = ('simulator', 'uncertainty', 'n_terms', 'bias', 'cutout')

    simulator: DirectSimulator
    uncertainty: Uncertainty
    n_terms: int
    bias: float
    cutout: float
    deviations: Floats
    names: tuple[str, ...]
    _each: NDArray[np.str_]  # for each entry of the state: the quantity, and which number of it
    _number: Ints
    _columns: dict[str, tuple[Ints, Ints]]
    _meshes: list[Varied]

    def __init__(self, simulator: DirectSimulator, uncertainty: Uncertainty, n_terms: int,
                 bias: float, cutout: float) -> None:
        put(self, simulator=simulator, uncertainty=uncertainty, n_terms=n_terms, bias=bias,
            cutout=cutout)
        terms = np.append(uncertainty.natural_curvature,
                          uncertainty.curvature_variation * variation_deviations(n_terms - 1))
        every: dict[str, Sequence[float] | Floats] = {
                 'bending_stiffness': [uncertainty.bending_stiffness],
                 'torsional_stiffness': [uncertainty.torsional_stiffness],
                 'mass': [uncertainty.mass],
                 'length': [uncertainty.length], 'natural_curvature': np.repeat(terms, 2),
                 'gripper_rotation': [uncertainty.gripper_rotation] * 3,
                 'gripper_position': [uncertainty.gripper_position] * 3,
                 'camera': [bias] * 3, 'cutout': [cutout] * 3}
        each = np.array([name for name, values in every.items() for _ in values])
        number = np.concatenate([np.arange(len(values)) for values in every.values()])
        deviations = np.concatenate([np.asarray(values, dtype=float)
                                     for values in every.values()])
        known = deviations > 0
        put(self, _meshes=[], deviations=deviations[known], _each=each[known],
            _number=number[known],
            names=tuple(f'{name}[{k}]' if len(every[name]) > 1 else str(name)
                        for name, k in zip(each[known], number[known], strict=True)))
        put(self, _columns={name: (np.flatnonzero(self._each == name),
                                   self._number[self._each == name]) for name in every})
        super().__post_init__()

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, name) for name in self._PARTS)

    @property
    def causes(self) -> list[str]:
        """Name in Uncertainty of what each of the n numbers is part of."""
        return ['curvature_variation' if name == 'natural_curvature' and number > 1 else str(name)
                for name, number in zip(self._each, self._number, strict=True)]

    @property
    def size(self) -> int:
        """The number n of entries of the state."""
        return self.deviations.size

    def varied(self, like: Discretization) -> Varied:
        """Return the Varied on the mesh of a Discretization, scaled to the stated length."""
        length = self.simulator.rod.length
        s = np.append(like.s[:-1] * (length / like.s[-1]), length)
        for known in self._meshes:
            mesh = known.mesh
            if mesh.basis == like.basis and mesh.s.size == s.size and (
                    np.abs(mesh.s - s).max() <= _SAME * length):
                return known
        if len(self._meshes) == _KEPT:
            self._meshes.pop(0)
        self._meshes.append(Varied(self, Discretization(self.simulator.surroundings, s,
                                                        like.basis, like.n_terms)))
        return self._meshes[-1]

    def columns(self, name: str) -> tuple[Ints, Ints]:
        """Return indices (k,) in the state, and (k,) in the quantity `name`, of its k numbers."""
        return self._columns[name]

    def part(self, z: Floats, name: str, size: int) -> Floats:
        """Return the numbers (size,) of one quantity; 0 for those that are not in the state."""
        out = np.zeros(size)
        where, number = self.columns(name)
        out[number] = z[where]
        return out

    def terms(self, z: Floats) -> Floats:
        """Return (n_terms, 2) Legendre terms that are added to the natural curvature, 1/m."""
        return self.part(z, 'natural_curvature', 2 * self.n_terms).reshape(-1, 2)

    def gripper_twist(self, z: Floats, error: Floats | None = None) -> Floats:
        """Return (6,): rotation vector, rad, and place, m, of `offset`."""
        twist = np.append(self.part(z, 'gripper_rotation', 3), self.part(z, 'gripper_position', 3))
        return twist if error is None else twist + error

    def offset(self, z: Floats, error: Floats | None = None) -> Pose:
        """Return the true Pose of the gripper in the frame of the measured one.

        Shapes: z (n,), error (6,).
        """
        twist = self.gripper_twist(z, error)
        return Pose.from_rotation(twist[3:], Rotation.from_rotvec(twist[:3]).as_matrix())

    def camera(self, z: Floats) -> Floats:
        """Return (3,) the camera's bias, m."""
        return self.part(z, 'camera', 3)

    def shifted(self, z: Floats) -> Floats:
        """Return (3,) the displacement of the cut-out, true minus stated, m, world axes."""
        return self.part(z, 'cutout', 3)

    def factors(self, z: Floats) -> tuple[Floats, float]:
        """Return the factors (3,) of GJ, EI_n, EI_b, and the factor of all masses."""
        bend, twist, mass = (float(np.exp(self.part(z, name, 1)[0])) for name in (
            'bending_stiffness', 'torsional_stiffness', 'mass'))
        return np.array([twist, bend, bend]), mass

    def rod(self, z: Floats) -> Rod:
        """Return the Rod at z (n,)."""
        rod = self.simulator.rod
        (twist, bend, _), mass = self.factors(z)
        length = rod.length + self.part(z, 'length', 1)[0]
        section = rod.section
        if section is not None:
            section = replace(section, youngs_modulus=bend * section.youngs_modulus,
                              shear_modulus=twist * section.shear_modulus)
        natural, terms = rod.natural_curvature, self.terms(z)
        if terms.any():
            natural = Expanded(natural, terms, length)
        longer = of_length(rod, length)
        return replace(
            longer, section=section,
            bending_stiffness=scaled(rod.bending_stiffness, bend),
            torsional_stiffness=scaled(rod.torsional_stiffness, twist),
            mass_per_length=scaled(rod.mass_per_length, mass), tip_mass=mass * rod.tip_mass,
            point_masses=tuple((s, mass * kg) for s, kg in longer.point_masses),
            natural_curvature=natural)


def element_means(x: Floats, n_terms: int) -> Floats:
    """Return (N, n_terms): means of the Legendre polynomials between nodes x (N + 1,)."""
    integrals = [legval(x, legint(unit)) for unit in np.eye(n_terms)]
    means: Floats = (np.diff(integrals, axis=1) / np.diff(x)).T
    return means


def mesh_of(shape: Shape) -> Discretization:
    """Return the Discretization on which a simulator found a Shape."""
    assert shape.state.mesh is not None  # only a shape that was loaded has none
    return shape.state.mesh


class Varied:
    """The Discretization of the DLO at a state z on one mesh, without computing it from the Rod.

    Parameters
    ----------
    uncertain : Uncertain
    mesh : Discretization
        Discretization of the DLO as stated.

    Attributes
    ----------
    legendre : ndarray, shape (N, n_terms)
        Means of P_j over the elements.
    by_length : dict
        Derivatives of the Problem's fields by the length, by name; {} if it is certain.

    Raises
    ------
    InvalidTask
        The length is uncertain and something jumps along the DLO.
    """

    legendre: Floats
    by_length: dict[str, Floats]

    def __init__(self, uncertain: Uncertain, mesh: Discretization) -> None:
        self.uncertain, self.mesh = uncertain, mesh
        self.legendre = element_means(2 * mesh.s / mesh.s[-1] - 1, uncertain.n_terms)
        self.weight = -node_masses(mesh.rod, mesh.s)[:, None] * mesh.surroundings.gravity
        self.by_length = self._by_length() if uncertain.columns('length')[0].size else {}

    def at(self, z: Floats) -> Discretization:
        """Return the Discretization of the DLO at z (n,)."""
        uncertain, system = self.uncertain, self.mesh.static
        factors, mass = uncertain.factors(z)
        more = uncertain.part(z, 'length', 1)[0]
        fields = {name: getattr(system, name) + more * change
                  for name, change in self.by_length.items()}
        natural = np.array(fields.get('natural', system.natural))
        natural[:, 1:] += self.legendre @ uncertain.terms(z)
        result: Discretization = self.mesh.varied(**{
                              **fields, 'natural': natural,
                              'stiffness': factors * fields.get('stiffness', system.stiffness),
                              'pull': fields.get('pull', system.pull) + (mass - 1) * self.weight})
        return result

    def _by_length(self) -> dict[str, Floats]:
        rod, length = self.mesh.rod, self.mesh.rod.length
        step = _PART * length
        near = length - step  # what is there moves with the end
        back, ahead = (self.mesh.of(replace(
            rod, length=length + d,
            nodes=tuple(length + d if s >= near else s for s in rod.nodes),
            point_masses=tuple((length + d if s >= near else s, kg)
                               for s, kg in rod.point_masses))) for d in (-step, step))
        if not back.s.size == self.mesh.s.size == ahead.s.size:
            raise InvalidTask('uncertainty.length: expected 0 where something jumps along the DLO')
        return {name: (getattr(ahead.static, name) - getattr(back.static, name)) / (2 * step)
                for name in ('lengths', 'natural', 'stiffness', 'pull')}
