# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""cosseratbench's validations: this package beside PyElastica and MuJoCo, by its own metrics.

Others take minutes and do not change: what was measured of them on this machine is kept, and
measured again on another one, or with FRESH=1 in the environment.
"""

import json
import os
from importlib.util import find_spec

import numpy as np

from benchmarks import report

EXPERIMENTS = ('cantilever', 'catenary', 'pendulum', 'crossing', 'twist')
OURS = 'dlo_planner'
_METRICS = {'cantilever': ('tip_deflection_error',), 'catenary': ('shape_error', 'sag_error'),
            'pendulum': ('period_error', 'amplitude_change'),
            'crossing': ('shape_error', 'lift_error'), 'twist': ('critical_twist_error',)}


def scored(experiment, solver):
    """Return outcome, s, why not, and metrics of a solver, as JSON can hold them."""
    from cosseratbench.experiment import finite, run  # noqa: PLC0415  an extra
    try:
        result = run(experiment, solver)
    except Exception as error:  # noqa: BLE001  a solver that does not fit its library's version
        return {'outcome': 'failed', 'wall_s': None, 'why': str(error)[:200], 'metrics': {}}
    return {'outcome': result.outcome, 'wall_s': result.wall_time,
            'why': result.failure or ', '.join(result.missing), 'metrics': finite(result.metrics)}


def ranks(results: dict[str, dict], metric: str | None) -> list[str]:
    """Return the solvers that completed, the best first by a metric, by time if it is None."""
    def size(name):
        result = results[name]
        return result['wall_s'] if metric is None else abs(result['metrics'][metric])

    done = [name for name, result in results.items() if result['outcome'] == 'completed'
            and (not result.get('elsewhere') if metric is None
                 else result['metrics'].get(metric) is not None)]
    return sorted(done, key=size)


def _measured(experiment, other, before):
    """Return what another solver scores, what it scored before if it cannot run, else None."""
    result = None
    if find_spec({'pyelastica': 'elastica'}.get(other, other)):
        from cosseratbench import registry  # noqa: PLC0415  an extra
        result = scored(experiment, registry.load_solver(other))
    if result is not None and (result['outcome'] != 'failed' or before['outcome'] == 'failed'):
        return result
    if before['outcome'] == 'completed':  # its errors are known, its time is another machine's
        return before | {'elsewhere': True}
    return before if before['outcome'] != 'failed' else result


def lines(found: dict[str, dict[str, dict]]) -> list[list[str]]:
    """Return the rows of the table."""
    rows = []
    for experiment, results in found.items():
        best = {metric: ranks(results, metric)[:1] for metric in (*_METRICS[experiment], None)}
        for solver, result in results.items():
            if result['outcome'] != 'completed':
                rows.append([experiment, solver, result['outcome'], result['why']])
                continue
            errors = [_marked(f'{metric} {result["metrics"][metric]:.2g}',
                              best[metric] == [solver]) for metric in _METRICS[experiment]]
            away = ' on another machine' if result.get('elsewhere') else ''
            rows.append([experiment, solver, _marked(f'{result["wall_s"]:.3g} s{away}',
                                                     best[None] == [solver]), ', '.join(errors)])
    return rows


def _marked(text, best):
    return f'**{text}**' if best else text


def lift_of_the_reference() -> float:
    """Return what the suite's metric says of its own reference, sampled at the nodes it scores."""
    from cosseratbench import registry  # noqa: PLC0415  an extra
    from cosseratbench.trajectory import Trajectory  # noqa: PLC0415

    experiment = registry.load_experiment('crossing')
    scenario = experiment.build(**{one.name: one.default for one in experiment.parameters})
    nodes = np.linspace(0, 1, experiment.n_elements + 1)
    exact = tuple(np.array([[np.interp(nodes, np.linspace(0, 1, len(curve)), row)
                             for row in np.transpose(curve)]]).swapaxes(1, 2)
                  for curve in experiment.reference(scenario))
    beside = tuple(rod.directors(experiment.n_elements)[None] for rod in scenario.rods)
    return float(experiment.metrics['lift_error'](scenario, Trajectory(
        np.zeros(1), exact, beside)))


def main(folder):
    """Run this package, and the others where they are not known; print and write the table."""
    if find_spec('cosseratbench') is None:
        print('cosseratbench is not installed (extra `peers`)')
        return
    from cosseratbench import registry  # noqa: PLC0415

    from benchmarks.cosserat.solver import DloPlanner  # noqa: PLC0415

    kept = folder / 'suite.json'
    said = json.loads(kept.read_text()) if kept.exists() else {'suite': {}, 'machine': {}}
    here = said['machine'].get('cpu') == report.machine()['cpu'] and not os.environ.get('FRESH')
    found = {}
    for name in EXPERIMENTS:
        experiment = registry.load_experiment(name)
        before = said['suite'].get(name, {})
        found[name] = {OURS: scored(experiment, DloPlanner())}
        for other in ('pyelastica', 'mujoco'):
            result = before.get(other, {'outcome': 'failed'})
            if not (here and result['outcome'] != 'failed'):
                result = _measured(experiment, other, result)
            if result is not None:
                found[name][other] = result
    lift = lift_of_the_reference()
    found['crossing']['its reference, at the nodes'] = {
        'outcome': 'exact', 'wall_s': None, 'why': f'lift_error {lift:.2g}',
        'metrics': {'lift_error': lift}}
    rows = lines(found)
    for row in rows:
        print(' | '.join(row), flush=True)
    report.write(folder, 'suite', '# cosseratbench', report.markdown(
        ['experiment', 'solver', 'time', 'errors (the best of each in bold)'], rows), found)
