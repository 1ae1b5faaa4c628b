# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is not known of a DLO, its gripper and a camera: numbers that are 0 where all is as stated.

`RodParameters` are those of the rod: what it is like at x, on a mesh without computing that anew,
and how points of an equilibrium move with x. Fits, estimates and robustness vary a DLO by these.
`UncertainState` adds the gripper and the camera, and the prior that an `Uncertainty` states.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.legendre import legint, legval
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from dlo_planner.direct.continuation import follow
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape, kernel_arrays
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.statics import equilibrium
from dlo_planner.energy.loads import node_masses
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.kinematics import part_of_element
from dlo_planner.geometry.so3 import left_jacobian
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import number
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, of_length
from dlo_planner.model.supports import FarEnd
from dlo_planner.model.value import Value, put
from dlo_planner.model.varying import Along, Expanded, Scaled, Shifted, Table, scaled
from dlo_planner.plan.goals import Through

# Quantities whose x is a logarithm, and what it scales: of GJ, EI_n, EI_b; of the masses spread
# along the DLO, those at points, that at its tip.
STIFFNESS: dict[str, tuple[float, ...]] = {
    'bending_stiffness': (0.0, 1.0, 1.0), 'bending_stiffness_n': (0.0, 1.0, 0.0),
    'bending_stiffness_b': (0.0, 0.0, 1.0), 'torsional_stiffness': (1.0, 0.0, 0.0)}
MASSES: dict[str, tuple[float, ...]] = {
    'mass': (1.0, 1.0, 1.0), 'mass_per_length': (1.0, 0.0, 0.0), 'tip_mass': (0.0, 0.0, 1.0)}
# Natural strains, 1/m, and which components of a strain they are.
STRAINS: dict[str, tuple[int, ...]] = {'natural_twist': (0,), 'natural_curvature': (1, 2)}
VARIATION = 5  # Legendre polynomials by which the natural curvature of a sample varies
_STEP = 1e-4   # of the length: of difference quotients of what depends on the length
_TURN = 1e-4   # rad along the length: of those by strains
_TOLD = 1e-9   # of a strain: a series tells it but for so little
_KEPT = 8      # meshes that are remembered
_SAME = 1e-9   # of the length: nodes closer than this are the same


@dataclass(frozen=True, eq=False, repr=False)
class Uncertainty(Value):
    """Standard deviations of uncertain quantities, all independent and normal.

    Attributes
    ----------
    bending_stiffness : float
        Relative deviation of EI_n and EI_b alike.
    torsional_stiffness : float
        Relative deviation of GJ.
    mass : float
        Relative deviation of all masses alike.
    length : float
        Deviation in m of the length beyond the gripper.
    natural_curvature : float
        Deviation in 1/m of each of its two components, the same all along.
    gripper_position : float
        Deviation in m along each axis.
    gripper_rotation : float
        Deviation in rad about each axis; constant during a plan, as a calibration is.
    curvature_variation : float
        Deviation in 1/m of each of the natural curvature's two components about its
        mean, as root mean square along the DLO: Legendre polynomials P_1, P_2, ..., the higher the
        less, see `variation_deviations`.
    """

    bending_stiffness: float = 0.0
    torsional_stiffness: float = 0.0
    mass: float = 0.0
    length: float = 0.0
    natural_curvature: float = 0.0
    gripper_position: float = 0.0
    gripper_rotation: float = 0.0
    curvature_variation: float = 0.0

    def __post_init__(self) -> None:
        put(self, **{name: number(f'Uncertainty.{name}', getattr(self, name), minimum=0)
                     for name in CAUSES})
        super().__post_init__()


CAUSES = tuple(field.name for field in fields(Uncertainty))


def variation_deviations(count: int) -> Floats:
    """Return (count,): standard deviations of the coefficients of P_1 ... P_count.

    The mean square along the DLO is 1; the part of P_j falls like 1 / j^2: its slope is bounded.
    """
    j = np.arange(1, count + 1)
    return np.sqrt((2 * j + 1) / j**2 / np.sum(1 / j**2)) if count else np.zeros(0)


class RodParameters(Value):
    """Numbers x (n,) by which a Rod differs from the one that is stated, x = 0.

    Stiffnesses and masses are logarithms of factors, length is in m, damping in 1/s and s. Natural
    curvature (k_n, k_b) and twist in 1/m are coefficients of functions of s.
    """

    _PARTS = ('rod', 'quantities', 'numbers', 'knots')

    rod: Rod                     # as stated
    quantities: tuple[str, ...]  # of each of the n numbers, what it is of
    numbers: tuple[int, ...]     # which of that: 2 j, 2 j + 1 of a curvature, of function j
    knots: Floats | None  # (k,) m, between which functions are straight; None: Legendre polynomials

    def __init__(self, rod: Rod, quantities: Iterable[str], numbers: Iterable[int],
                 knots: Floats | None = None) -> None:
        put(self, rod=rod, quantities=tuple(quantities), numbers=tuple(numbers), knots=knots)
        super().__post_init__()

    @property
    def size(self) -> int:
        """The number n."""
        return len(self.quantities)

    @cached_property
    def n_functions(self) -> int:
        """How many functions of s the natural strains are made of."""
        if self.knots is not None:
            return self.knots.size
        return 1 + max((self.functions(name)[0].max(initial=0) for name in STRAINS), default=0)

    @cached_property
    def _columns(self) -> dict[str, tuple[Ints, Ints]]:
        names, numbers = np.array(self.quantities), np.array(self.numbers, dtype=int)
        return {name: (np.flatnonzero(names == name), numbers[names == name])
                for name in {*STIFFNESS, *MASSES, *STRAINS, 'length', 'damping'}}

    def columns(self, name: str) -> tuple[Ints, Ints]:
        """Return indices (k,) in x, and (k,) in the quantity `name`, of its k numbers."""
        return self._columns[name]

    def functions(self, name: str) -> tuple[Ints, Ints]:
        """Return for each number of a natural strain its function of s and strain component."""
        which, components = self.columns(name)[1], np.array(STRAINS[name])
        return which // components.size, components[which % components.size]

    @cached_property
    def _logarithms(self) -> tuple[Floats, Floats]:
        """(3, n) each: which entries of x STIFFNESS and MASSES add up."""
        stiffness, masses = (np.array([table.get(name, (0.0,) * 3) for name in self.quantities]
                                      ).reshape(-1, 3).T for table in (STIFFNESS, MASSES))
        return stiffness, masses

    def stiffness_factors(self, x: Floats) -> Floats:
        """Return the factors (3,) of GJ, EI_n, EI_b at x."""
        result: Floats = np.exp(self._logarithms[0] @ x)
        return result

    def mass_factors(self, x: Floats) -> Floats:
        """Return the factors (3,) of the masses along the DLO, at points, at its tip, at x."""
        result: Floats = np.exp(self._logarithms[1] @ x)
        return result

    def coefficients(self, x: Floats) -> Floats:
        """Return (k, 3): of each function of s what is added to the natural strains, 1/m."""
        out = np.zeros((self.n_functions, 3))
        for name in STRAINS:
            out[self.functions(name)] = x[self.columns(name)[0]]
        return out

    def lengthened(self, x: Floats) -> float:
        """Return by how much the rod is longer at x, m."""
        return float(x[self.columns('length')[0]].sum())

    def means(self, s: Floats) -> Floats:
        """Return (N, k): means of the functions of s between the nodes of a mesh s (N + 1,)."""
        if self.knots is None:
            x = 2 * s / s[-1] - 1
            integrals = legval(x, legint(np.eye(self.n_functions)))
        else:
            x = s
            ends = np.clip(np.unique([0.0, *self.knots, s[-1]]), 0.0, s[-1])
            hats = np.array([np.interp(ends, self.knots, unit)
                             for unit in np.eye(self.knots.size)])
            integrals = make_interp_spline(ends, hats, k=1, axis=1).antiderivative()(s)
        means: Floats = (np.diff(integrals, axis=1) / np.diff(x)).T
        return means

    def at(self, x: Floats) -> Rod:
        """Return the Rod at x (n,)."""
        rod, changes = self.rod, dict[str, Any]()
        twist, *bend = self.stiffness_factors(x).tolist()
        spread, points, tip = self.mass_factors(x).tolist()
        length = rod.length + self.lengthened(x)
        alone = any(self.columns(f'bending_stiffness_{axis}')[0].size for axis in 'nb')
        changes |= {'bending_stiffness': _scaled(rod.bending_stiffness, np.array(bend)),
                    'torsional_stiffness': scaled(rod.torsional_stiffness, twist),
                    'mass_per_length': scaled(rod.mass_per_length, spread),
                    'tip_mass': tip * rod.tip_mass}
        if rod.section is not None:
            changes['section'] = None if alone else replace(
                rod.section, youngs_modulus=bend[0] * rod.section.youngs_modulus,
                shear_modulus=twist * rod.section.shear_modulus)
        for name in STRAINS:
            if self.columns(name)[0].size:
                changes[name] = self._natural(name, x, length)
        if self.columns('damping')[0].size:
            changes['damping'] = tuple(np.maximum(
                np.array(rod.damping) + x[self.columns('damping')[0]], 0.0))
        longer = of_length(rod, length)
        return replace(longer, point_masses=tuple((s, points * kg) for s, kg in
                                                  longer.point_masses), **changes)

    def _natural(self, name: str, x: Floats, length: float) -> Along:
        """Return a natural strain at x: numbers where it is constant, else a function of s."""
        components, stated = list(STRAINS[name]), getattr(self.rod, name)
        terms = self.coefficients(x)[:, components]
        if self.knots is not None:
            values = self.rod.natural_strains(self.knots)[:, components] + terms
            if len(values) > 1:
                return Table(self.knots, values if len(components) > 1 else values[:, 0])
            stated, terms = values[0], np.zeros_like(terms)
        if terms[1:].any():
            return Expanded(stated, terms, length)
        if callable(stated):
            return Shifted(stated, terms[0])
        values = np.atleast_1d(stated) + terms[0]
        return tuple(values.tolist()) if len(components) > 1 else float(values[0])


def _scaled(content: Along, factors: Floats) -> Along:
    """Return a pair, or a function of s, times factors (2,)."""
    if factors[0] == factors[1]:
        return scaled(content, float(factors[0]))
    return Scaled(content, factors) if callable(content) else tuple(content * factors)


class ParameterizedMesh:
    """The mesh of a DLO at x, without computing it from the Rod; points of equilibria by x.

    `mesh` is a Discretization of the DLO as stated, for `at`; for `slopes` alone one at any x does
    that is as long. InvalidTask: the length is uncertain and something jumps along the DLO.
    """

    def __init__(self, parameters: RodParameters, mesh: Discretization) -> None:
        self.parameters, self.mesh = parameters, mesh
        self.means = parameters.means(mesh.s)
        rod, s = parameters.rod, mesh.s
        everything, spread, tip = (node_masses(one, s) for one in (
            rod, replace(rod, tip_mass=0.0, point_masses=()),
            replace(rod, point_masses=())))
        tip = tip - spread
        # (3, N + 1, 3) N: derivatives of the potential by the nodes' places, by what MASSES tells
        self._weights = -np.array([spread, everything - spread - tip, tip])[
            :, :, None] * mesh.surroundings.gravity
        self.by_length = self._by_length() if parameters.columns('length')[0].size else {}

    def at(self, x: Floats) -> Discretization:
        """Return the Discretization of the DLO at x (n,)."""
        parameters, system = self.parameters, self.mesh.static
        more = parameters.lengthened(x)
        fields = {name: getattr(system, name) + more * change
                  for name, change in self.by_length.items()}
        heavier = parameters.mass_factors(x) - 1
        result: Discretization = self.mesh.varied(**{
            **fields, 'natural': fields.get('natural', system.natural)
            + self.means @ parameters.coefficients(x),
            'stiffness': parameters.stiffness_factors(x) * fields.get('stiffness',
                                                                      system.stiffness),
            'pull': fields.get('pull', system.pull) + np.tensordot(heavier, self._weights, 1)})
        return result

    def equilibrium(self, x: Floats, gripper: Pose, before: Shape | None = None,
                    followed: bool = True) -> Shape:
        """Return the Shape at x, `converged` or not: from `before`, followed to another gripper."""
        mesh = self.at(x)

        def solved(gripper: Pose, initial: Shape | None, _far_end: FarEnd | None = None,
                   _most: float = np.inf) -> Shape:
            strains = mesh.natural if initial is None else initial.element_strains
            if initial is not None and len(strains) != mesh.s.size - 1:
                strains = mesh.strains_from(initial.s * (mesh.s[-1] / initial.s[-1]), strains)
            return equilibrium(mesh, gripper, strains)

        if before is None or not followed:
            return solved(gripper, before)
        # first the equilibrium at x in the gripper's pose of `before`: following starts from one
        return follow(solved, solved(before.gripper, before), gripper)

    def slopes(self, x: Floats, shape: Shape, s: Floats, sensitivity: Sensitivity) -> Floats:
        """Return (m, 3, n) derivatives by x of the points at s (m,) of an equilibrium at x.

        The gripper stays, and a point at its part of the length.
        """
        return moved_points(shape, s, *self.strain_slopes(x, shape, sensitivity))

    def strain_slopes(self, x: Floats, shape: Shape,
                      sensitivity: Sensitivity) -> tuple[Floats, Floats]:
        """Return derivatives by x of the strains (n, N, 3) and of the elements' stretch (n, N).

        A change of the potential changes the strains by a solve with the Hessian.
        """
        parameters = self.parameters
        system = shape.state.made_on.static
        stiff = np.diff(shape.s)[:, None] * system.stiffness
        yields = shape.state.made_on.yields
        bent = shape.bent if yields else shape.element_strains - system.natural
        gradients, natural = np.zeros((2, parameters.size, *bent.shape))
        for name, part in STIFFNESS.items():
            gradients[parameters.columns(name)[0]] = stiff * bent * np.array(part)
        for name in STRAINS:
            for column, function, axis in zip(parameters.columns(name)[0],
                                              *parameters.functions(name), strict=True):
                natural[column, :, axis] = self.means[:, function]
        gradients -= stiff * natural
        weights = parameters.mass_factors(x)[:, None, None] * self._weights
        for name, part in MASSES.items():
            for column in parameters.columns(name)[0]:
                gradients[column] = sensitivity.slope_of(pull=system.pull + np.tensordot(
                    part, weights, 1)) - sensitivity.slope_of()
        stretch = np.zeros((parameters.size, len(bent)))
        for column in parameters.columns('length')[0]:
            by_length = {**self.by_length, 'stiffness': parameters.stiffness_factors(x)
                         * self.by_length['stiffness']}
            step = 0.1 * _STEP * shape.s[-1]
            less, more = (sensitivity.slope_of(**{
                name: getattr(system, name) + side * step * change
                for name, change in by_length.items()}) for side in (-1, 1))
            gradients[column] = (more - less) / (2 * step)
            stretch[column] = self.by_length['lengths'] / np.diff(shape.s)
        # what a series cannot tell of a natural strain stays in it (by how little that moves a held
        # end is left out)
        own = np.zeros_like(natural)
        if system.basis.shape[1]:
            lengths = np.diff(shape.s)[:, None]
            own = natural - system.scale * (system.basis @ (
                system.basis.T @ (natural / system.scale * lengths)))
        step = _TURN / shape.s[-1]
        for k in np.flatnonzero(natural.any(axis=(1, 2)) if yields else
                                np.abs(own).max(axis=(1, 2)) > _TOLD):
            less, more = (sensitivity.slope_of(
                side * step * own[k], natural=system.natural + side * step * natural[k])
                for side in (-1, 1))
            gradients[k] = (more - less) / (2 * step)
        acts = np.flatnonzero(gradients.any(axis=(1, 2)))
        strains = own
        strains[acts] += sensitivity.strains_by(gradients[acts])
        return strains, stretch

    def _by_length(self) -> dict[str, Floats]:
        """Return the derivatives of the Problem's fields by the length."""
        rod, length = self.mesh.rod, self.mesh.rod.length
        step = _STEP * length
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


def moved_points(shape: Shape, s: Floats, strains: Floats, stretch: Floats) -> Floats:
    """Return (m, 3, k): how the points at s (m,) move by k changes, the gripper held.

    Shapes: strains (k, N, 3), 1/m; stretch (k, N) of the elements, in parts of their lengths.
    """
    elements = np.clip(np.searchsorted(shape.s, s, side='right') - 1, 0, shape.s.size - 2)
    fractions = (s - shape.s[elements]) / np.diff(shape.s)[elements]
    lengths, own, rotations, _ = kernel_arrays(shape)
    # a longer arc of the same curvature: a larger one that turns as much further
    changes = strains + stretch[:, :, None] * own
    result: Floats = _moved_points(lengths, own, rotations, elements, fractions, changes, stretch)
    return result


@kernel
def _moved_points(lengths: Floats, strains: Floats, rotations: Floats, elements: Ints,
                  fractions: Floats, changes: Floats, stretch: Floats) -> Floats:
    """Return (m, 3, k): motions of points inside elements by changes (k, N, 3), stretch (k, N)."""
    count, n = changes.shape[0], lengths.size
    shift, turn = np.zeros((n + 1, count, 3)), np.zeros((n + 1, count, 3))  # of the nodes
    out = np.empty((elements.size, 3, count))
    part, arm, unscaled, moved = np.empty((6, 3)), np.empty(3), np.ones(3), np.empty(6)
    for p in range(n + elements.size):
        e, fraction = (p, 1.0) if p < n else (elements[p - n], fractions[p - n])
        part_of_element(lengths[e], fraction, strains[e], unscaled, rotations[e], part, arm)
        for k in range(count):
            for i in range(6):
                moved[i] = (part[i, 0] * changes[k, e, 0] + part[i, 1] * changes[k, e, 1]
                            + part[i, 2] * changes[k, e, 2])
            for i in range(3):
                a, b = (i + 1) % 3, (i + 2) % 3
                moved[3 + i] += (shift[e, k, i] + stretch[k, e] * arm[i]
                                 + turn[e, k, a] * arm[b] - turn[e, k, b] * arm[a])
            for i in range(3):
                if p < n:
                    turn[e + 1, k, i] = turn[e, k, i] + moved[i]
                    shift[e + 1, k, i] = moved[3 + i]
                else:
                    out[p - n, i, k] = moved[3 + i]
    return out


class UncertainState(Value):
    """The n numbers z of an estimate's state, with a normal prior: the rod, the gripper, a camera.

    First those of `RodParameters`, then, all 0 where it is as stated:

        gripper_rotation, gripper_position             rad and m, in the gripper's frame
        camera                                         m, world axes: seen minus true
        cutout                                         m, world axes: true minus stated

    Only numbers with a standard deviation above 0 are in it. Shapes show only the ratio of
    stiffness to weight; the priors divide it between both.
    """

    _PARTS = ('simulator', 'uncertainty', 'n_terms', 'bias', 'cutout')

    simulator: DirectSimulator  # of the DLO as stated, elastic, without obstacles
    uncertainty: Uncertainty
    n_terms: int   # Legendre terms of each natural curvature
    bias: float    # standard deviations of the camera's bias and of the cut-out's place, m
    cutout: float
    parameters: RodParameters
    deviations: Floats  # (n,) of the prior, all > 0
    names: tuple[str, ...]
    causes: tuple[str, ...]  # names in Uncertainty of what each number is part of
    _columns: dict[str, tuple[Ints, Ints]]
    _meshes: list[ParameterizedMesh]

    def __init__(self, simulator: DirectSimulator, uncertainty: Uncertainty, n_terms: int,
                 bias: float = 0.0, cutout: float = 0.0) -> None:
        put(self, simulator=simulator, uncertainty=uncertainty, n_terms=n_terms, bias=bias,
            cutout=cutout)
        terms = np.append(uncertainty.natural_curvature,
                          uncertainty.curvature_variation * variation_deviations(n_terms - 1))
        prior: dict[str, Sequence[float] | Floats] = {
            **{name: [getattr(uncertainty, name)] for name in (
                'bending_stiffness', 'torsional_stiffness', 'mass', 'length')},
            'natural_curvature': np.repeat(terms, 2),
            'gripper_rotation': [uncertainty.gripper_rotation] * 3,
            'gripper_position': [uncertainty.gripper_position] * 3,
            'camera': [bias] * 3, 'cutout': [cutout] * 3}
        entries = [(name, k, deviation) for name, deviations in prior.items()
                   for k, deviation in enumerate(deviations) if deviation > 0]
        each = np.array([name for name, _, _ in entries])
        number_ = np.array([k for _, k, _ in entries], dtype=int)
        of_rod = [(name, k) for name, k, _ in entries
                  if name not in ('gripper_rotation', 'gripper_position', 'camera', 'cutout')]
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
        """Return the true Pose of the gripper in the frame of the measured one.

        Shapes: z (n,), error (6,) of the robot, rad before m.
        """
        twist = self._gripper_twist(z, error)
        return Pose.from_rotation(twist[3:], Rotation.from_rotvec(twist[:3]).as_matrix())

    def camera(self, z: Floats) -> Floats:
        """Return (3,) the camera's bias, m."""
        return self._part(z, 'camera')

    def shifted(self, z: Floats) -> Floats:
        """Return (3,) the displacement of the cut-out, true minus stated, m, world axes."""
        return self._part(z, 'cutout')

    def slopes(self, z: Floats, shape: Shape, error: Floats | None = None) -> PointSlopes:
        """Return the PointSlopes by z of the equilibrium `shape` at z.

        With an `error` of the robot (6,): by that as well, see `offset`.
        """
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

    def miss(self, goal: Through) -> tuple[Floats, Floats, Floats]:
        """Return by how much the Shape misses a point, (3,) m, and derivatives (3, n) of that.

        They are across the DLO, which may pass elsewhere along itself; (3, 3) is what is across.
        """
        s, (off, tangent, _) = goal.nearest(self.shape)
        across = np.eye(3) - np.outer(tangent, tangent)
        return off, across @ self(np.array([s]))[0], across


def stretched(shape: Shape, length: float) -> Shape:
    """Return a Shape on a mesh of another length, to start from."""
    share = length / shape.s[-1]
    return replace(shape, s=np.append(shape.s[:-1] * share, length),
                   state=shape.state.forgotten())
