# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of a DLO: numbers x that are 0 where it is as stated.

`RodParameters` say what a rod is like at x, `ParameterizedMesh` does on a mesh without computing
that anew, and how points of an equilibrium move with x. Fits, estimates and robustness vary a DLO
by these; `Unknowns` are those of a fit in units of about one size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial.legendre import legint, legval
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline

from dlo_planner.direct.continuation import follow
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.equilibrium import equilibrium
from dlo_planner.direct.sensitivity import HangingSensitivities, Sensitivity
from dlo_planner.direct.shape import Shape, kernel_arrays
from dlo_planner.energy.loads import node_masses
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.kinematics import part_of_element
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import choice, items, number, row
from dlo_planner.model.holds import Holds
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, of_length
from dlo_planner.model.value import Value, put
from dlo_planner.model.varying import Along, Expanded, Mapped, Table, scaled

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
_BENT = 0.1    # rad along the length: one unit of a natural strain
_DAMPED = 0.1  # twice the damping ratio that is one unit of damping
_SLOWEST = 3.516  # w L^2 sqrt(m / EI) of a cantilever
_FARTHEST = 60.0  # of all unknowns
# of logarithms of factors: no first guess of a stiffness or mass is off by 1e8; a search that goes
# on, because no such rod has the points, would leave the range of what a material can be
_LARGEST = np.log(1e8)
_OFF = 0.5  # a bound: without damping a motion may go anywhere
_LOGARITHMS = (*STIFFNESS, 'mass_per_length', 'tip_mass')
_NAMES = (*_LOGARITHMS, *STRAINS, 'damping')
_UNCERTAINTY = {'bending_stiffness_n': 'bending_stiffness',
                'bending_stiffness_b': 'bending_stiffness', 'mass_per_length': 'mass',
                'tip_mass': 'mass'}


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
    mass_gradient : float
        Deviation of how much the mass per length grows evenly from the gripper to the free end, as
        a part of its mean, which stays. It bends a DLO otherwise in each direction of the gripper:
        no stiffness, mass or curvature stands for it.
    """

    bending_stiffness: float = 0.0
    torsional_stiffness: float = 0.0
    mass: float = 0.0
    length: float = 0.0
    natural_curvature: float = 0.0
    gripper_position: float = 0.0
    gripper_rotation: float = 0.0
    curvature_variation: float = 0.0
    mass_gradient: float = 0.0

    def __post_init__(self) -> None:
        put(self, **{name: number(f'Uncertainty.{name}', getattr(self, name), minimum=0)
                     for name in CAUSES})
        super().__post_init__()


CAUSES = tuple(field.name for field in fields(Uncertainty))


def variation_deviations(count: int) -> Floats:
    """Return (count,) deviations of the coefficients of P_1, ...: like 1 / j^2, mean square 1."""
    j = np.arange(1, count + 1)
    return np.sqrt((2 * j + 1) / j**2 / np.sum(1 / j**2)) if count else np.zeros(0)


class RodParameters(Value):
    """Numbers x (n,) by which a Rod differs from the one that is stated, x = 0.

    Stiffnesses and masses are logarithms of factors, length is in m, damping in 1/s and s. Natural
    curvature (k_n, k_b) and twist in 1/m are coefficients of functions of s; the gradient of the
    mass is a part of its mean, see `Uncertainty`.
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
                for name in {*STIFFNESS, *MASSES, *STRAINS, 'length', 'damping', 'mass_gradient'}}

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
        return np.exp(self._logarithms[0] @ x)

    def mass_factors(self, x: Floats) -> Floats:
        """Return the factors (3,) of the masses along the DLO, at points, at its tip, at x."""
        return np.exp(self._logarithms[1] @ x)

    def mass_gradient(self, x: Floats) -> float:
        """Return by which part of its mean the mass per length grows along the DLO at x."""
        return float(x[self.columns('mass_gradient')[0]].sum())

    def _mass_per_length(self, factor: float, gradient: float, length: float) -> Along:
        """Return a factor of the mass per length, kg/m, with a gradient in a length, m."""
        content = scaled(self.rod.mass_per_length, factor)
        if not gradient:
            return content
        mean = factor * _own_mass(self.rod) / self.rod.length
        growth = np.array([0.0, 0.5 * gradient * mean])  # P_1 goes from -1 to 1
        return Expanded(content, growth, length)

    @property
    def tapered(self) -> Rod:
        """The Rod as stated, without tip and point masses, with a gradient of its mass of 1."""
        return replace(self.rod, tip_mass=0.0, point_masses=(), mass_per_length=(
            self._mass_per_length(1.0, 1.0, self.rod.length)))

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
                    'mass_per_length': self._mass_per_length(spread, self.mass_gradient(x), length),
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
        if callable(stated) or terms[1:].any():
            return Expanded(stated, terms, length)
        values = np.atleast_1d(stated) + terms[0]
        return tuple(values.tolist()) if len(components) > 1 else float(values[0])


def _scaled(content: Along, factors: Floats) -> Along:
    """Return a pair, or a function of s, times factors (2,)."""
    if factors[0] == factors[1]:
        return scaled(content, float(factors[0]))
    return Mapped(content, factors) if callable(content) else tuple(content * factors)


class Unknowns:
    """Unknowns x (n,), 0 for the first guess: `RodParameters` in units of about one size.

    Stiffness and masses are logarithms; a unit of natural strains bends or twists the DLO by 0.1
    rad, one of damping is about 5 % of critical damping of the slowest vibration. Natural strains
    at `knots` (k,), m, are straight between; else constant. InvalidTask: names that make no sense.
    """

    lower: Floats    # (n,) bounds of x
    upper: Floats
    begin: Floats    # (n,) where to begin: 0, but off the bounds
    stiff: Floats    # (n,) 1 for stiffness, 0 else

    def __init__(self, rod: Rod, names: Iterable[str], knots: ArrayLike | None = None) -> None:
        self.rod, self.names = rod, items('parameters', names, str, least=1)
        self.knots = None
        if knots is not None:
            self.knots = row('knots', knots, least=1, minimum=0, maximum=rod.length)
            if (np.diff(self.knots) <= 0).any():
                raise InvalidTask(f'knots = {self.knots.tolist()!r}: expected arc lengths that '
                                  'grow')
        for name in self.names:
            choice('parameters', name, _NAMES)
        _check(rod, self.names, self.knots)
        n_knots = 1 if self.knots is None else self.knots.size
        counts = [n_knots * len(STRAINS[name]) if name in STRAINS else 1 + (name == 'damping')
                  for name in self.names]
        each = np.repeat(self.names, counts)
        self.parameters = RodParameters(
            rod, each.tolist(), (k for count in counts for k in range(count)),
            self.knots if {*self.names} & {*STRAINS} else None)
        self.size = each.size
        self.stiff = np.isin(each, tuple(STIFFNESS)).astype(float)
        self.units = np.where(np.isin(each, tuple(STRAINS)), _BENT / rod.length, 1.0)
        self.lower, self.upper = np.full(self.size, -_FARTHEST), np.full(self.size, _FARTHEST)
        self.upper[np.isin(each, _LOGARITHMS)] = _LARGEST
        self.lower[np.isin(each, _LOGARITHMS)] = -_LARGEST
        if 'damping' in self.names:  # it does not feed a motion
            damped = self.parameters.columns('damping')[0]
            self.units[damped] = _damping_units(rod)
            self.lower[damped] = -np.array(rod.damping) / self.units[damped]
            self.upper[damped] = np.inf
        self.begin = np.where(self.lower > -_OFF, self.lower + _OFF, 0.0)

    def run_off(self, x: Floats) -> list[str]:
        """Return the names of stiffnesses and masses that are as far from the guess as may be."""
        return [name for name in self.names if name in _LOGARITHMS and (
            np.abs(x[self.parameters.columns(name)[0]]) > _LARGEST - _OFF).any()]

    def of(self, x: Floats) -> Rod:
        """Return the Rod at unknowns x (n,)."""
        return self.parameters.at(self.units * x)

    def values(self, x: Floats) -> dict[str, Any]:
        """Return dict of the parameters' values at x, SI units."""
        rod = self.of(x)
        return {name: self._written(name, self._numbers(rod, name)) for name in self.names}

    def deviations(self, x: Floats, spread: Floats) -> dict[str, Any]:
        """Return the standard deviations of the values at x, by those of x (n,).

        What is known by its logarithm is log-normal: known badly, its deviation is larger yet.
        """
        rod, out = self.of(x), {}
        for name in self.names:
            where = self.parameters.columns(name)[0]
            numbers = self.units[where] * spread[where]
            if name in _LOGARITHMS:
                with np.errstate(over='ignore'):
                    numbers = self._numbers(rod, name) * np.exp(0.5 * numbers**2) * np.sqrt(
                        np.expm1(numbers**2))
            out[name] = self._written(name, numbers)
        return out

    def _numbers(self, rod: Rod, name: str) -> Floats:
        """Return the numbers that tell a property of a Rod; means where what is scaled varies."""
        if name in STIFFNESS:
            return rod.stiffness[np.flatnonzero(STIFFNESS[name])]
        if name in STRAINS:
            at = np.zeros(1) if self.knots is None else self.knots
            return rod.natural_strains(at)[:, list(STRAINS[name])].ravel()
        if name == 'mass_per_length':
            return np.array([_own_mass(rod) / rod.length])
        return np.atleast_1d(getattr(rod, name)).astype(float)

    def _written(self, name: str, numbers: Floats) -> Any:
        """Return the numbers of a parameter as its value is written: alone, as pair, per knot."""
        values = tuple(numbers.tolist())
        if name in STRAINS and self.knots is not None:
            width = len(STRAINS[name])
            return values if width == 1 else tuple(
                values[k:k + 2] for k in range(0, len(values), 2))
        return values[0] if len(values) == 1 else values

    @property
    def columns(self) -> Ints:
        """(numbers of all values,) the unknown that tells each; a pair with a ratio has one."""
        return np.concatenate([np.repeat(self.parameters.columns(name)[0],
                                         1 + (name == 'bending_stiffness')) for name in self.names])

    def prior(self, uncertainty: Uncertainty) -> Floats:
        """Return (n,): 1 / standard deviation of each unknown in an Uncertainty, 0 for none."""
        out = np.zeros(self.size)
        for name in self.names:
            where = self.parameters.columns(name)[0]
            known = getattr(uncertainty, _UNCERTAINTY.get(name, name), 0.0)
            if known:
                out[where] = self.units[where] / known
        return out


def _check(rod: Rod, names: Sequence[str], knots: Floats | None) -> None:
    if len(set(names)) < len(names):
        raise InvalidTask(f'parameters = {names!r}: expected each name once')
    if 'bending_stiffness' in names and {*names} & {'bending_stiffness_n', 'bending_stiffness_b'}:
        raise InvalidTask(f'parameters = {names!r}: expected bending_stiffness or its components, '
                          'not both')
    for name in STRAINS:
        if name in names and knots is None and callable(getattr(rod, name)):
            raise InvalidTask(f'Rod.{name}: expected numbers where it is to be found, or knots')
    if 'tip_mass' in names and not rod.tip_mass:
        raise InvalidTask('Rod.tip_mass = 0: expected a first guess where it is to be found')
    if 'mass_per_length' in names and not _own_mass(rod):
        raise InvalidTask('Rod.mass_per_length = 0: expected a first guess where it is to be found')
    if knots is not None and not {*names} & {*STRAINS}:
        raise InvalidTask(f'knots: expected natural_curvature or natural_twist among the '
                          f'parameters, got {names!r}')


def _own_mass(rod: Rod) -> float:
    """Return the mass that is spread along a Rod, kg."""
    return float(rod.node_masses(np.array([0.0, rod.length])).sum())


def _damping_units(rod: Rod) -> Floats:
    mass = _own_mass(rod) + rod.tip_mass + sum(kg for _, kg in rod.point_masses)
    if mass == 0:
        raise InvalidTask('Rod.mass_per_length = 0: expected some mass where damping is to be '
                          'found')
    rate = _SLOWEST * np.sqrt(rod.stiffness[1:].min() / (mass * rod.length**3))
    return np.array([_DAMPED * rate, _DAMPED / rate])


class ParameterizedMesh:
    """The mesh of a DLO at x, without computing it from the Rod; points of equilibria by x.

    `mesh` is a Discretization of the DLO as stated, for `at`; for `slopes` alone one at any x does
    that is as long. InvalidTask: the length is uncertain and something jumps along the DLO.
    """

    def __init__(self, parameters: RodParameters, mesh: Discretization) -> None:
        self.parameters, self.mesh = parameters, mesh
        self.means = parameters.means(mesh.s)
        rod, s = parameters.rod, mesh.s
        everything, spread, tip, tapered = (node_masses(one, s) for one in (
            rod, replace(rod, tip_mass=0.0, point_masses=()),
            replace(rod, point_masses=()), parameters.tapered))
        tip = tip - spread
        # (4, N + 1, 3) N: derivatives of the potential by the nodes' places, by what MASSES tells
        # and by the gradient
        self._weights = -np.array([spread, everything - spread - tip, tip, tapered - spread])[
            :, :, None] * mesh.surroundings.gravity
        self.by_length = self._by_length() if parameters.columns('length')[0].size else {}

    def at(self, x: Floats) -> Discretization:
        """Return the Discretization of the DLO at x (n,)."""
        parameters, system = self.parameters, self.mesh.static
        more = parameters.lengthened(x)
        fields = {name: getattr(system, name) + more * change
                  for name, change in self.by_length.items()}
        spread, points, tip = parameters.mass_factors(x)
        heavier = spread - 1, points - 1, tip - 1, spread * parameters.mass_gradient(x)
        return self.mesh.varied(**{
            **fields, 'natural': fields.get('natural', system.natural)
            + self.means @ parameters.coefficients(x),
            'stiffness': parameters.stiffness_factors(x) * fields.get('stiffness',
                                                    system.stiffness),
            'pull': fields.get('pull', system.pull) + np.tensordot(heavier, self._weights, 1)})

    def equilibrium(self, x: Floats, gripper: Pose, before: Shape | None = None,
                    followed: bool = True) -> Shape:
        """Return the Shape at x, `converged` or not: from `before`, followed to another gripper."""
        mesh = self.at(x)

        def solved(gripper: Pose, initial: Shape | None, _holds: Holds = (),
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
        """Return (m, 3, n) slopes of points at s (m,), m, at their parts of the length."""
        return moved_points(shape, s, *self.strain_slopes(x, shape, sensitivity))

    def strain_slopes(self, x: Floats, shape: Shape,
                      sensitivity: Sensitivity) -> tuple[Floats, Floats]:
        """Return derivatives by x of the strains (n, N, 3) and of the elements' stretch (n, N)."""
        made_on = shape.state.made_on
        bent = shape.bent if made_on.yields else shape.element_strains - made_on.natural

        def slope_of(more: Floats | float = 0.0, **fields: Floats) -> Floats:
            return sensitivity.slope_of(more, **fields)[None]

        (gradients,), strains, stretch = self._causes(x, made_on, bent[None], slope_of)
        acts = np.flatnonzero(gradients.any(axis=(1, 2)))
        strains[acts] += sensitivity.strains_by(gradients[acts])
        return strains, stretch

    def strain_slopes_of(self, x: Floats, shapes: HangingSensitivities
                         ) -> tuple[Floats, Floats, Floats]:
        """Return the same (m, n, N, 3), (n, N) of m shapes, and by their grippers' turns, too.

        The latter are (m, 3, N, 3).
        """
        gradients, strains, stretch = self._causes(
            x, shapes.mesh, shapes.strains - shapes.mesh.natural, shapes.slope_of)
        acts = np.flatnonzero(gradients.any(axis=(0, 2, 3)))
        turned, answers = shapes.answers(gradients[:, acts])
        out = np.repeat(strains[None], len(answers), axis=0)
        out[:, acts] += answers
        return out, stretch, turned

    def _causes(self, x: Floats, made_on: Discretization, bent: Floats,
                slope_of: Callable[..., Floats]) -> tuple[Floats, Floats, Floats]:
        """Return how the potential's slopes by the strains change with x, of m shapes (m, n, N, 3).

        Then by how much strains (n, N, 3) and the elements' stretch (n, N) do so themselves.

        Args:
            made_on: the mesh of the shapes
            bent: (m, N, 3) their strains since the stress-free shape, 1/m
            slope_of: `Sensitivity.slope_of` of all of them, (m, N, 3)
        """
        parameters, system, lengths = self.parameters, made_on.static, np.diff(made_on.s)
        stiff = lengths[:, None] * system.stiffness
        natural = np.zeros((parameters.size, *stiff.shape))
        gradients = np.zeros((len(bent), *natural.shape))
        for name, part in STIFFNESS.items():
            for column in parameters.columns(name)[0]:
                gradients[:, column] = stiff * bent * np.array(part)
        for name in STRAINS:
            for column, function, axis in zip(parameters.columns(name)[0],
                                              *parameters.functions(name), strict=True):
                natural[column, :, axis] = self.means[:, function]
        gradients -= stiff * natural
        factors, gradient = parameters.mass_factors(x), parameters.mass_gradient(x)
        weights = np.append(factors, factors[0])[:, None, None] * self._weights
        by_mass = {name: (*part, part[0] * gradient) for name, part in MASSES.items()}
        for name, by_weights in (*by_mass.items(), ('mass_gradient', (0.0, 0.0, 0.0, 1.0))):
            for column in parameters.columns(name)[0]:
                gradients[:, column] = slope_of(pull=system.pull + np.tensordot(
                    by_weights, weights, 1)) - slope_of()
        stretch = np.zeros((parameters.size, lengths.size))
        for column in parameters.columns('length')[0]:
            by_length = {**self.by_length, 'stiffness': parameters.stiffness_factors(x)
                         * self.by_length['stiffness']}
            step = 0.1 * _STEP * made_on.s[-1]
            less, more = (slope_of(**{
                name: getattr(system, name) + side * step * change
                for name, change in by_length.items()}) for side in (-1, 1))
            gradients[:, column] = (more - less) / (2 * step)
            stretch[column] = self.by_length['lengths'] / lengths
        # what a series cannot tell of a natural strain stays in it (by how little that moves a held
        # end is left out)
        own = np.zeros_like(natural)
        if system.basis.shape[1]:
            terms = np.einsum('iej,kei->kji', system.basis,
                              natural / system.scale * lengths[:, None])
            told = np.einsum('iej,kji->kei', system.basis, terms, order='C')
            own = natural - system.scale * told
        step = _TURN / made_on.s[-1]
        for k in np.flatnonzero(natural.any(axis=(1, 2)) if made_on.yields else
                                np.abs(own).max(axis=(1, 2)) > _TOLD):
            less, more = (slope_of(side * step * own[k],
                                   natural=system.natural + side * step * natural[k])
                          for side in (-1, 1))
            gradients[:, k] = (more - less) / (2 * step)
        return gradients, own, stretch

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
    """Return how points move (m, 3, k) by changes of strains (k, N, 3) and of stretch (k, N)."""
    elements, fractions = elements_at(shape.s, s)
    lengths, own, rotations, _ = kernel_arrays(shape)
    # a longer arc of the same curvature: a larger one that turns as much further
    changes = strains + stretch[:, :, None] * own
    return _moved_points(lengths, own, rotations, elements, fractions, changes, stretch)


def elements_at(nodes: Floats, s: Floats) -> tuple[Ints, Floats]:
    """Return the elements (m,) in which arc lengths s (m,) are, and the parts of them before."""
    elements = np.clip(np.searchsorted(nodes, s, side='right') - 1, 0, nodes.size - 2)
    return elements, (s - nodes[elements]) / np.diff(nodes)[elements]


@kernel
def moved_points_of(lengths: Floats, strains: Floats, rotations: Floats, elements: Ints,
                    fractions: Floats, changes: Floats, stretch: Floats) -> Floats:
    """Return (n, m, 3, k) what `moved_points` does of n shapes.

    Shapes: strains (n, N, 3), rotations (n, N + 1, 3, 3), changes (n, k, N, 3), stretch (k, N).
    """
    n, count = changes.shape[0], changes.shape[1]
    out = np.empty((n, elements.size, 3, count))
    own = np.empty(changes.shape[1:])
    for j in range(n):
        for k in range(count):
            for e in range(lengths.size):
                for i in range(3):
                    own[k, e, i] = changes[j, k, e, i] + stretch[k, e] * strains[j, e, i]
        out[j] = _moved_points(lengths, strains[j], rotations[j], elements, fractions, own, stretch)
    return out


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
