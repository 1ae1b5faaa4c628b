# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a Fit found, as parameters: for the YAML file of the node and of the command line."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.identify.fitting import Fit
from dlo_planner.model.rod import Rod
from dlo_planner.settings.building import rod_of

_ALIKE = ('natural_curvature', 'natural_twist', 'tip_mass', 'damping')  # parameters as they are
_POISSON = (-0.99, 0.5)
NAMES = ('bending_stiffness', 'torsional_stiffness', 'mass_per_length', *_ALIKE)


def identified(fit: Fit, values: Mapping[str, Any]) -> dict[str, object]:
    """Return the parameters (name -> value) that change by a Fit.

    Stiffness and mass of a DLO with a section become its Young's modulus, Poisson's ratio and
    density; where no Poisson's ratio gives that torsion, the section becomes 'stiffness'.
    """
    for name, value in fit.values.items():
        if name not in NAMES or np.ndim(value) > 1:
            raise InvalidTask(f'fit.values[{name!r}]: expected one of {", ".join(NAMES)}, constant '
                              'along the DLO')
    out = {f'rod.{name}': _plain(fit.values[name]) for name in _ALIKE if name in fit.values}
    changed = {'bending_stiffness', 'torsional_stiffness', 'mass_per_length'} & fit.values.keys()
    if not changed:
        return out
    if values['rod.section'] == 'stiffness':
        return out | _by_stiffness(fit.rod, changed)
    bend, twist, mass = _ratios(fit, values)
    poisson = (1 + values['rod.poisson_ratio']) * bend / twist - 1
    if not _POISSON[0] <= poisson <= _POISSON[1]:
        every = {'bending_stiffness', 'torsional_stiffness', 'mass_per_length'}
        return {'rod.section': 'stiffness'} | _by_stiffness(fit.rod, every) | out
    return out | {'rod.youngs_modulus': values['rod.youngs_modulus'] * bend,
                  'rod.poisson_ratio': float(poisson),
                  'rod.density': values['rod.density'] * mass}


def _ratios(fit: Fit, values: Mapping[str, Any]) -> tuple[float, float, float]:
    """Return by which bending stiffness, torsional stiffness and mass have grown."""
    before, after, middle = rod_of(values), fit.rod, [0.5 * values['rod.length']]
    (twist, bend, _), = after.stiffnesses(middle) / before.stiffnesses(middle)
    mass, = after.masses_per_length(middle) / before.masses_per_length(middle)
    return float(bend), float(twist), float(mass)


def _by_stiffness(rod: Rod, names: Collection[str]) -> dict[str, object]:
    (twist, *bend), = rod.stiffnesses([0.5 * rod.length])
    mass, = rod.masses_per_length([0.5 * rod.length])
    known = {'bending_stiffness': [float(one) for one in bend], 'torsional_stiffness': float(twist),
             'mass_per_length': float(mass)}
    return {f'rod.{name}': known[name] for name in known if name in names}


def _plain(value: ArrayLike) -> object:
    return np.asarray(value, dtype=float).tolist()
