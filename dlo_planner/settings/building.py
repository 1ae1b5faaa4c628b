# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the values of parameters describe: the DLO, its simulators, the gripper's limits."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from math import isnan
from typing import Any

import numpy as np

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.model.checks import vector
from dlo_planner.model.rod import Rod
from dlo_planner.model.varying import Expanded
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.workspace import Workspace
from dlo_planner.verify.uncertainty import Uncertainty

SECTIONS = ('round', 'tube', 'rectangular', 'stiffness')
_FINEST = 1e-6         # accuracy, of the length: a shape takes less than a second
_MOST_TOLERANCE = 1.0  # m
_MOST_GRAVITY = 1e4    # m/s^2

Values = Mapping[str, Any]  # of all names in ENTRIES


def direct_of(values: Values, obstacles: Iterable[Any] = ()) -> DirectSimulator:
    """Return the DirectSimulator that parameter values describe.

    Parameters
    ----------
    values : Values
        Values of all names in ENTRIES.
    obstacles : iterable of object, optional
        For the DLO.

    Raises
    ------
    DloPlannerError
        A value, or their combination, makes no sense.
    """
    rod = rod_of(values)
    _judge(values)
    options: dict[str, Any] = {'accuracy': values['simulator.accuracy']}
    if not options['accuracy']:
        options = {'n_elements': values['simulator.n_elements']}
        if values['simulator.basis'] != 'local':
            options['n_terms'] = values['simulator.n_terms']
    return DirectSimulator(rod, basis=values['simulator.basis'], gravity=values['gravity'],
                           obstacles=obstacles, **options)


def inverse_of(values: Values, direct: DirectSimulator) -> InverseSimulator:
    """Return the InverseSimulator of a DirectSimulator, with the workspace of the values."""
    workspace = Workspace(values['workspace.lower'], values['workspace.upper'], direct.obstacles,
                          values['workspace.gripper_radius'])
    return InverseSimulator(direct, workspace=workspace,
                            allow_plastic=values['threading.may_yield'])


def limits_of(values: Values) -> Limits:
    """Return the Limits of the gripper's motion."""
    return Limits(**{item.name: values[f'threading.{item.name}'] for item in fields(Limits)})


def spread_of(values: Values) -> Uncertainty:
    """Return the Uncertainty of what is uncertain."""
    return Uncertainty(**{item.name: values[f'spread.{item.name}'] for item in fields(Uncertainty)})


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
    """Return the Rod."""
    section = values['rod.section']
    if len(values['rod.damping']) != 2:
        raise InvalidTask(f'parameter rod.damping = {values["rod.damping"]}: expected two numbers, '
                          '1/s times mass and s times stiffness')
    more: dict[str, Any] = {name: values[f'rod.{name}'] for name in (
        'natural_twist', 'tip_mass', 'damping', 'hardening')}
    more['natural_curvature'] = _natural_curvature(values)
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
