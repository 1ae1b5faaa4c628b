# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""An Estimate as the node's parameters: what is identified counts from then on, and is saved."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dlo_planner.identify.estimate import Estimate
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose

_MOST_POISSON = 0.5
_SECTIONS = 'youngs_modulus', 'density'
_STIFFNESSES = 'bending_stiffness', 'mass_per_length'


def identified(estimate: Estimate, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters (name -> value) that change by an Estimate.

    Torsion of a section is told by Poisson's ratio, which is 0.5 at most.

    Parameters
    ----------
    estimate : Estimate
        Estimate of the DLO that `values` describe.
    values : dict
        dict of all parameters, see `ros.parameters`.
    """
    uncertain, z = estimate.uncertain, estimate.mean
    (twist, bend, _), mass = uncertain.factors(z)
    terms = uncertain.terms(z)
    sized = values['rod.section'] != 'stiffness'
    stiffness, weight = (f'rod.{name}' for name in (_SECTIONS if sized else _STIFFNESSES))
    out = {stiffness: _times(values[stiffness], bend), weight: _times(values[weight], mass),
           'rod.tip_mass': values['rod.tip_mass'] * mass,
           'rod.length': float(values['rod.length'] + uncertain.part(z, 'length', 1)[0]),
           'rod.natural_curvature': (np.array(values['rod.natural_curvature'])
                                     + terms[0]).tolist(),
           'rod.natural_curvature_terms': _sum(values['rod.natural_curvature_terms'], terms[1:])}
    if sized:
        ratio = (1 + values['rod.poisson_ratio']) * bend / twist - 1
        out['rod.poisson_ratio'] = float(min(ratio, _MOST_POISSON))
    else:
        out['rod.torsional_stiffness'] = float(values['rod.torsional_stiffness'] * twist)
    tool = Pose(values['tool.position'], values['tool.orientation']).compose(
        estimate.gripper_offset)
    return out | {'tool.position': tool.position.tolist(),
                  'tool.orientation': tool.quaternion.tolist()}


def told(estimate: Estimate) -> str:
    """Return in a sentence what an Estimate says: the numbers that were told by what was seen."""
    values, deviations = estimate.values, estimate.deviations
    prior = dict(zip(estimate.names, estimate.uncertain.deviations.tolist(), strict=True))
    said = [f'{name} {values[name]:+.3g} +- {deviations[name]:.1g}' for name in estimate.names
            if deviations[name] < 0.7 * prior[name]]
    return (f'{estimate.looks} looks, points {1e3 * estimate.misfit:.2g} mm off, '
            f'{estimate.outliers:.0%} of them outliers: {", ".join(said) or "nothing told"}')


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
