# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a fit says of a cable that is not like the model: five ways, one at a time.

python -m benchmarks.deform_unlike [--output FOLDER]

Cable 2 of `benchmarks.deform_surrogate` with 1 mm of noise, straight, stiffness and damping sought.
A misfit far above the noise says that the model is not right; a small one, that it is right enough:
then what is found has to be within its deviations.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import deform, report
from benchmarks.deform_chain import by_chain
from benchmarks.deform_data import Array, Recording, arc_lengths
from benchmarks.deform_doubt import doubted
from benchmarks.deform_surrogate import CABLES, softness
from dlo_planner import DirectSimulator, fit_rod
from dlo_planner.identify import Fit

_BEFORE, _FRAMES, _NOISE = 150, 300, 1e-3
_MADE = CABLES[2]
_SHAKEN = 200, 201  # seeds of two recordings


@dataclass(frozen=True)
class _Case:
    """How a cable differs: arguments of `by_chain`, and what is done to its markers."""

    name: str
    more: dict[str, float]
    seen: Callable[[Array], Array] = lambda markers: markers


def _late(markers: Array) -> Array:
    out = markers.copy()
    out[2:, 2:-2] = markers[:-2, 2:-2]
    return out


def _above(markers: Array) -> Array:
    return markers + np.outer([0, 0, *[1] * (markers.shape[1] - 4), 0, 0], [0, 0, 5e-3])


CASES = (
    _Case('nothing', {}),
    _Case('free markers seen 20 ms late', {}, _late),
    _Case('free markers 5 mm above the cable', {}, _above),
    _Case('drag by the square of the velocity, 2 1/m', {'squared': 2.0}),
    _Case('stretch by its weight, 1 %', {'springs': 0.03 * 9.81 * _MADE.length / 0.01}))


def recorded(case: _Case) -> list[Recording]:
    """Return the Recordings of a case."""
    out = []
    for seed in _SHAKEN:
        clean = by_chain(seed, _FRAMES + _BEFORE, _MADE.length, 0.03, _MADE.rod.stiffness[1],
                         _MADE.damping[0], _MADE.markers, **case.more)[0][_BEFORE:]
        noise = _NOISE * np.random.default_rng(seed).standard_normal(clean.shape)
        out.append(Recording(str(seed), case.seen(clean) + noise))
    return out


def fitted(found: list[Recording]) -> deform.Cable:
    """Return the straight Cable of Recordings, sought from what cable 2 was made of."""
    s, frames, effort = arc_lengths(found), range(0, _FRAMES, 4), deform.Effort()
    rod = replace(_MADE.rod, length=s[-1])
    direct = DirectSimulator(rod, **effort.mesh)
    motions = [doubted(deform._motion(one, frames, s), one, frames, direct) for one in found]
    fit: Fit = fit_rod(rod, motions=motions, parameters=('bending_stiffness', 'damping'),
                       noise=_NOISE, **effort.mesh)
    return deform.Cable(fit.rod, s, fit, effort, 0.0)


def row(case: _Case) -> list[str]:
    """Return the row of a case."""
    cable = fitted(recorded(case))
    spread = float(np.ravel(cable.fit.deviations['bending_stiffness'])[0] / cable.rod.stiffness[1])
    off = abs(np.log(softness(cable) / _MADE.softness)) / spread
    damping = ', '.join(f'{value:.2g} ± {one:.1g}' for value, one in zip(
        cable.fit.values['damping'], cable.fit.deviations['damping'], strict=True))
    return [case.name, f'{cable.unexplained:.2f}',
            f'{softness(cable):.2f} ± {softness(cable) * spread:.2f}', f'{off:.1f}', damping]


def main(arguments: list[str] | None = None) -> int:
    """Run it; return 0."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.deform_unlike',
                                     description=__doc__.splitlines()[0])
    parser.add_argument('--output', type=Path, help='folder for tables')
    given = parser.parse_args(arguments)
    rows = []
    for case in CASES:
        rows.append(row(case))
        print(' | '.join(rows[-1]), flush=True)
    heads = ['not in the model', 'misfit / noise', f'w L^3 / EI, true {_MADE.softness:g}',
             'off, in deviations', f'damping a, b; true {_MADE.damping[0]:g}, {_MADE.damping[1]:g}']
    if given.output:
        report.write(given.output, 'deform_unlike', '# Cables unlike the model',
                     report.markdown(heads, rows), {one[0]: one[1:] for one in rows})
    return 0


if __name__ == '__main__':
    sys.exit(main())
