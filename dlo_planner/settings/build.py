# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the values of parameters describe, and what a fit or an estimate changes in them."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import fields
from math import isnan
from typing import Any

import numpy as np

from dlo_planner.direct.grasp import GraspedInside
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.fit import Fit
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, number, vector
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, with_plug
from dlo_planner.model.supports import PointLoad
from dlo_planner.model.varying import Expanded
from dlo_planner.plan.requirements import Limits
from dlo_planner.plan.workspace import Workspace
from dlo_planner.settings.parameters import PARAMETERS, unknown_parameter
from dlo_planner.uncertainty.parameters import Uncertainty

# What describes a DLO of each section; none of it has a default that could be meant.
_SOLID = ('density', 'youngs_modulus', 'poisson_ratio')
NEEDED = {
    'round': ('length', 'diameter', *_SOLID),
    'tube': ('length', 'diameter', 'inner_diameter', *_SOLID),
    'rectangular': ('length', 'width', 'thickness', *_SOLID),
    'stiffness': ('length', 'diameter', 'mass_per_length', 'bending_stiffness',
                  'torsional_stiffness')}
SECTIONS = tuple(NEEDED)
_BY_SECTION = {'yield_stress': ('round', 'tube', 'rectangular'),
               'yield_curvature': ('stiffness',), 'yield_torsion': ('stiffness',)}
_FINEST = 1e-6         # accuracy, of the length: a shape takes less than a second
_MOST_TOLERANCE = 1.0  # m
_MOST_GRAVITY = 1e4    # m/s^2
# Of a DLO of which nothing else is said: by how much it is bent over its length where it is said to
# be straight, 3 degrees and, unevenly, 2; and which part of a stated curvature may be wrong. These
# are assumptions, and the same at every scale.
_STRAIGHT, _EVENLY, _OF_STATED = 0.05, 0.03, 0.2  # rad, rad, 1

Values = Mapping[str, Any]  # of all names in PARAMETERS


def check_described(given: Iterable[str], section: str) -> None:
    """Refuse a DLO that is described in part: no other DLO's numbers stand in for its own."""
    given = set(given)
    for name in sorted(given):
        if name.startswith('rod.') and name not in PARAMETERS:
            raise InvalidTask(unknown_parameter(name, PARAMETERS))
    absent = [f'rod.{name}' for name in NEEDED[choice('parameter rod.section', section, SECTIONS)]
              if f'rod.{name}' not in given]
    if absent:
        raise InvalidTask(f'parameter {", ".join(absent)}: expected, a DLO of rod.section '
                          f'{section!r} is not described without (config/ has files of some)')


def without_effect(section: str) -> set[str]:
    """Return the names of the parameters that say nothing of a DLO of this section."""
    others = {name for names in NEEDED.values() for name in names} - set(NEEDED[section])
    others |= {name for name, sections in _BY_SECTION.items() if section not in sections}
    return {f'rod.{name}' for name in others}


def idle_warnings(given: Iterable[str], section: str) -> list[str]:
    """Return a warning of each parameter that was given and has no effect on this section."""
    return [f'parameter {name} has no effect where rod.section is {section}'
            for name in sorted(without_effect(section) & set(given))]


def direct_of(values: Values, obstacles: Iterable[Any] = ()) -> DirectSimulator:
    """Return the DirectSimulator that parameter values describe, of the DLO held at its beginning.

    `grasped_of` holds it where `rod.grasped_at` says.
    """
    rod, options = _described(values)
    return DirectSimulator(rod, obstacles=obstacles, **options)


def grasped_of(values: Values, direct: DirectSimulator) -> GraspedInside | None:
    """Return the GraspedInside of a DirectSimulator's DLO, None without rod.grasped_at."""
    at = values['rod.grasped_at']
    if not at:
        return None
    return GraspedInside.of(direct, number('parameter rod.grasped_at', at, above=0,
                                           below=direct.rod.length))


def refuse_grasped(values: Values, what: str) -> None:
    """Raise InvalidTask where rod.grasped_at is not 0, but has to be for `what`."""
    at = values['rod.grasped_at']
    if at:
        raise InvalidTask(f'parameter rod.grasped_at = {at:g}: expected 0 for {what}, which knows '
                          'of no DLO that is grasped inside')


def _described(values: Values) -> tuple[Rod, dict[str, Any]]:
    """Return the Rod, and the options of its simulator but the obstacles."""
    rod = rod_of(values)
    _judge(values)
    options: dict[str, Any] = {'accuracy': values['simulator.accuracy']}
    if not options['accuracy']:
        options = {'n_elements': values['simulator.n_elements']}
        if values['simulator.basis'] != 'local':
            options['n_terms'] = values['simulator.n_terms']
    loads = [PointLoad(force, s=s) for s, *force in _rows(values, 'rod.point_loads', 4)]
    return rod, {'basis': values['simulator.basis'], 'gravity': values['gravity'],
                 'point_loads': loads, 'self_contact': values['simulator.self_contact'],
                 'self_friction': values['simulator.self_friction'], **options}


def inverse_of(values: Values, direct: DirectSimulator,
               keep_out: Iterable[Any] = ()) -> InverseSimulator:
    """Return the InverseSimulator of a DirectSimulator, which keeps out of `keep_out`, too."""
    workspace = Workspace(values['workspace.lower'], values['workspace.upper'],
                          (*direct.obstacles, *keep_out), values['workspace.gripper_radius'])
    return InverseSimulator(direct, workspace=workspace,
                            allow_plastic=values['threading.may_yield'])


def limits_of(values: Values) -> Limits:
    """Return the Limits of the gripper's motion."""
    return Limits(**{item.name: values[f'threading.{item.name}'] for item in fields(Limits)})


def spread_of(values: Values) -> Uncertainty:
    """Return the Uncertainty of what is uncertain."""
    length, stated = values['rod.length'], float(np.linalg.norm(values['rod.natural_curvature']))
    by_dlo = {'natural_curvature': float(np.hypot(_STRAIGHT / length, _OF_STATED * stated)),
              'curvature_variation': _EVENLY / length}
    given = {item.name: values[f'spread.{item.name}'] for item in fields(Uncertainty)}
    return Uncertainty(**{name: by_dlo[name] if value < 0 else value
                          for name, value in given.items()})


def tolerance_of(values: Values) -> float | None:
    """Return the tolerance in motion, m; None, which means the default, for 0 and nan."""
    value = values['threading.tolerance']
    if isnan(value) or value == 0:
        return None
    if not 0 < value <= _MOST_TOLERANCE:
        raise InvalidTask(f'parameter threading.tolerance = {value!r}: expected more than 0 and at '
                          f'most {_MOST_TOLERANCE:g} m; 0 or nan for the default')
    result: float | None = value
    return result


def _judge(values: Values) -> None:
    """Refuse sizes that no DLO in a cell has; what else makes no sense the library refuses."""
    accuracy, finest = values['simulator.accuracy'], _FINEST * values['rod.length']
    if 0 < accuracy < finest:
        raise InvalidTask(f'parameter simulator.accuracy = {accuracy:g}: expected at least '
                          f'{finest:g} m, 1e-6 of the length; 0 for n_elements and n_terms')
    bounded('gravity', values['gravity'], _MOST_GRAVITY, 'm/s^2')


def bounded(name: str, value: Sequence[float], most: float, unit: str) -> None:
    """Raise InvalidTask if a vector is longer than `most`."""
    if not np.linalg.norm(np.nan_to_num(value, nan=0.0)) <= most:
        raise InvalidTask(f'parameter {name} = {list(value)}: expected a length of at most '
                          f'{most:g} {unit}')


def rod_of(values: Values) -> Rod:
    """Return the Rod, with its plug."""
    rod, plug = _bare_rod(values), {name: values[f'rod.plug.{name}'] for name in (
        'length', 'mass', 'radius')}
    if plug['length']:
        return with_plug(rod, plug['length'], plug['mass'], radius=plug['radius'] or None)
    if any(plug.values()):
        raise InvalidTask(f'parameter rod.plug.length = 0: expected more, of a plug with mass = '
                          f'{plug["mass"]:g} kg and radius = {plug["radius"]:g} m')
    return rod


def _bare_rod(values: Values) -> Rod:
    section = values['rod.section']
    if len(values['rod.damping']) != 2:
        raise InvalidTask(f'parameter rod.damping = {values["rod.damping"]}: expected two numbers, '
                          '1/s times mass and s times stiffness')
    more: dict[str, Any] = {name: values[f'rod.{name}'] for name in (
        'natural_twist', 'tip_mass', 'damping', 'hardening')}
    more['natural_curvature'] = _natural_curvature(values)
    more['point_masses'] = tuple(map(tuple, _rows(values, 'rod.point_masses', 2)))
    more['section_model'] = values['rod.section_model'] or None
    more['max_bend_curvature'] = values['rod.max_bend_curvature'] or None
    material = {name: values[f'rod.{name}'] for name in (
        'density', 'youngs_modulus', 'poisson_ratio')}
    material['yield_stress'] = values['rod.yield_stress'] or None
    length, diameter = values['rod.length'], values['rod.diameter']
    if section == 'round':
        return Rod.circular(length, diameter, **material, **more)
    if section == 'tube':
        return Rod.tube(length, diameter, values['rod.inner_diameter'], **material, **more)
    if section == 'rectangular':
        return Rod.rectangular(length, values['rod.width'], values['rod.thickness'], **material,
                               **more)
    if section == 'stiffness':
        return Rod(length, values['rod.mass_per_length'], tuple(values['rod.bending_stiffness']),
                   values['rod.torsional_stiffness'], radius=diameter / 2,
                   yield_curvature=_limits(values['rod.yield_curvature']),
                   yield_torsion=values['rod.yield_torsion'] or None, **more)
    raise InvalidTask(f'parameter rod.section = {section!r}: expected one of '
                      f'{", ".join(SECTIONS)}')


def _rows(values: Values, name: str, width: int) -> list[list[float]]:
    """Return a parameter's rows (a place first), without those that say nothing but 0."""
    listed = values[name]
    if len(listed) % width or not np.isfinite(listed).all():
        raise InvalidTask(f'parameter {name} = {listed!r}: expected finite numbers, {width} by '
                          f'{width}')
    return [row for row in np.reshape(listed, (-1, width)).tolist() if any(row[1:])]


def _natural_curvature(values: Values) -> Expanded | list[float]:
    """Return the pair, or the function of s where it varies."""
    even, terms = values['rod.natural_curvature'], values['rod.natural_curvature_terms']
    if len(terms) % 2 or not np.isfinite(terms).all():
        raise InvalidTask(f'parameter rod.natural_curvature_terms = {terms!r}: expected pairs of '
                          'finite numbers')
    if not any(terms):
        result: Expanded | list[float] = even
        return result
    rows = np.vstack([np.zeros(2), np.reshape(terms, (-1, 2))])
    return Expanded(tuple(vector('rod.natural_curvature', even, 2)), rows, values['rod.length'])


def _limits(curvatures: Sequence[float]) -> tuple[float, float] | None:
    """Return the pair for `Rod.yield_curvature`; None if both are 0, which means never."""
    about_n, about_b = vector('parameter rod.yield_curvature', curvatures, 2).tolist()
    return (about_n or 1e12, about_b or 1e12) if any(curvatures) else None


_ALIKE = ('natural_curvature', 'natural_twist', 'tip_mass', 'damping')  # parameters as they are
_POISSON = (-0.99, 0.5)
NAMES = ('bending_stiffness', 'torsional_stiffness', 'mass_per_length', *_ALIKE)


def parameters_of_fit(fit: Fit, values: Mapping[str, Any]) -> dict[str, object]:
    """Return the parameters (name -> value) that change by a Fit.

    Stiffness and mass of a DLO with a section become its Young's modulus, Poisson's ratio and
    density; where no Poisson's ratio gives that torsion, the section becomes 'stiffness'.
    """
    for name, value in fit.values.items():
        if name not in NAMES or np.ndim(value) > 1:
            raise InvalidTask(f'fit.values[{name!r}]: expected one of {", ".join(NAMES)}, constant '
                              'along the DLO')
    out = {f'rod.{name}': np.asarray(fit.values[name], dtype=float).tolist()
           for name in _ALIKE if name in fit.values}
    changed = {'bending_stiffness', 'torsional_stiffness', 'mass_per_length'} & fit.values.keys()
    if not changed:
        return out
    if values['rod.section'] == 'stiffness':
        return out | _by_stiffness(fit.rod, changed)
    before, after, middle = rod_of(values), fit.rod, [0.5 * values['rod.length']]
    (twist, bend, _), = after.stiffnesses(middle) / before.stiffnesses(middle)
    mass, = after.masses_per_length(middle) / before.masses_per_length(middle)
    poisson = (1 + values['rod.poisson_ratio']) * bend / twist - 1
    if not _POISSON[0] <= poisson <= _POISSON[1]:
        every = {'bending_stiffness', 'torsional_stiffness', 'mass_per_length'}
        return {'rod.section': 'stiffness'} | _by_stiffness(fit.rod, every) | out
    return out | {'rod.youngs_modulus': float(values['rod.youngs_modulus'] * bend),
                  'rod.poisson_ratio': float(poisson),
                  'rod.density': float(values['rod.density'] * mass)}


def _by_stiffness(rod: Rod, names: Collection[str]) -> dict[str, object]:
    (twist, *bend), = rod.stiffnesses([0.5 * rod.length])
    mass, = rod.masses_per_length([0.5 * rod.length])
    known = {'bending_stiffness': [float(one) for one in bend], 'torsional_stiffness': float(twist),
             'mass_per_length': float(mass)}
    return {f'rod.{name}': known[name] for name in known if name in names}


_SECTIONS = 'youngs_modulus', 'density'
_STIFFNESSES = 'bending_stiffness', 'mass_per_length'


def parameters_of_estimate(estimate: Estimate, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters that change by an Estimate; Poisson's ratio is 0.5 at most."""
    parameters = estimate.uncertain.parameters
    x = estimate.mean[:parameters.size]
    (twist, bend, _), (mass, *_) = (factors(x).tolist() for factors in (
        parameters.stiffness_factors, parameters.mass_factors))
    terms = parameters.coefficients(x)[:, 1:]
    sized = values['rod.section'] != 'stiffness'
    stiffness, weight = (f'rod.{name}' for name in (_SECTIONS if sized else _STIFFNESSES))
    out = {stiffness: _times(values[stiffness], bend), weight: _times(values[weight], mass),
           'rod.tip_mass': values['rod.tip_mass'] * mass,
           'rod.plug.mass': values['rod.plug.mass'] * mass,
           'rod.point_masses': [value * (mass if k % 2 else 1.0)
                                for k, value in enumerate(values['rod.point_masses'])],
           'rod.length': float(values['rod.length'] + parameters.lengthened(x)),
           'rod.natural_curvature': (np.array(values['rod.natural_curvature'])
                                     + terms[0]).tolist(),
           'rod.natural_curvature_terms': _sum(values['rod.natural_curvature_terms'], terms[1:])}
    if sized:
        ratio = (1 + values['rod.poisson_ratio']) * bend / twist - 1
        out['rod.poisson_ratio'] = float(min(ratio, _POISSON[1]))
    else:
        out['rod.torsional_stiffness'] = float(values['rod.torsional_stiffness'] * twist)
    tool = Pose(values['tool.position'], values['tool.orientation']).compose(
        estimate.gripper_offset)
    return out | {'tool.position': tool.position.tolist(),
                  'tool.orientation': tool.quaternion.tolist()}


def _times(value: Any, factor: float) -> Any:
    return [float(factor * part) for part in value] if isinstance(value, list) else float(
        factor * value)


def _sum(known: Sequence[float], terms: Floats) -> list[float]:
    """Return the sum of pairs that follow each other and of rows (n, 2), as pairs in a row."""
    pairs = np.asarray(known, dtype=float).reshape(-1, 2)
    out = np.zeros((max(len(pairs), len(terms)), 2))
    out[:len(pairs)] += pairs
    out[:len(terms)] += terms
    return out.ravel().tolist()
