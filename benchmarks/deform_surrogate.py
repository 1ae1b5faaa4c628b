# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Five cables of other engines: identified from recordings, then predicted for 5 s.

python -m benchmarks.deform_surrogate [--cables 1 2 3 4 5] [--noise 0.001] [--known]
                                      [--output FOLDER]

A table that is in FOLDER keeps the rows of other cables.

They stand for the DEFORM data set where it is not at hand: its layout, rate, number of markers and
length of recordings, its measure of error. Two engines make them that share nothing with the
simulators, 1 and 2 straight (`benchmarks.deform_chain`), 3 to 5 naturally bent along their length
(`benchmarks.deform_mujoco`, extra [peers]). They move already when a recording begins. What is
found is compared with what they were made of; a deviation that covers it is at least a third of its
distance.
"""

import argparse
import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import deform, report
from benchmarks.deform_chain import by_chain, grips
from benchmarks.deform_data import DT, Array, Recording
from dlo_planner import Rod

_STUB = 0.025             # m between the two markers of a gripper
_BEFORE = 150             # frames in which a motion gathers speed, not recorded
_FRAMES = 502
_TRAINING, _EVALUATED = 2, 2  # recordings of each cable
_KNOTS = 3                # of natural curvature along a cable
_COVERED = 3.0            # deviations


@dataclass(frozen=True)
class Made:
    """What a cable is made of; damping in 1/s and s; bends: rows (s / length, (k_n, k_b) in 1/m).

    Attributes:
        softness: w L^3 / EI
        cells: rigid pieces of MuJoCo; at rest cable 3 is off by 6.6 mm with 32, by 1.3 mm with 64,
            cable 4 by 0.4 mm with 32
    """

    length: float
    softness: float
    damping: tuple[float, float]
    markers: int = 12
    bends: tuple[tuple[float, tuple[float, float]], ...] = ()
    cells: int = 32

    @property
    def rod(self) -> Rod:
        """Rod of 30 g/m."""
        stiffness = 0.03 * 9.81 * self.length**3 / self.softness
        bends = tuple((s * self.length, pair) for s, pair in self.bends) or (0.0, 0.0)
        return Rod(self.length, 0.03, stiffness, 0.75 * stiffness, natural_curvature=bends,
                   damping=self.damping, radius=0.01)


CABLES = {
    1: Made(1.05, 60.0, (0.8, 0.0), 13),
    2: Made(0.95, 15.0, (1.2, 0.0)),
    3: Made(0.95, 40.0, (0.8, 2e-3), bends=((0.0, (0.6, -0.4)), (1.0, (-0.3, 0.5))), cells=64),
    4: Made(0.9, 90.0, (0.6, 3e-3), bends=((0.0, (1.0, 0.3)), (0.5, (0.4, 0.8)), (1.0, (0.8, 0)))),
    5: Made(1.0, 25.0, (1.0, 2e-3), bends=((0.0, (0.0, 0.5)), (1.0, (0.5, 0.0))))}


def recording(made: Made, seed: int, frames: int) -> Array:
    """Return a recording (frames, markers, 3), m, without noise."""
    total, rod = frames + _BEFORE, made.rod
    if not made.bends:
        return by_chain(seed, total, made.length, 0.03, rod.stiffness[1], made.damping[0],
                        made.markers)[0][_BEFORE:]
    from benchmarks.deform_mujoco import by_mujoco  # noqa: PLC0415  an extra
    held = grips(seed, total, made.length, _STUB)
    ramp = np.clip(np.arange(total) * DT, 0, 1)[:, None, None]
    held = held[0] + ramp**2 * (3 - 2 * ramp) * (held - held[0])
    return by_mujoco(rod, held, made.markers, made.cells)[_BEFORE:]


def recorded(number: int, noise: float, effort: deform.Effort, trained: bool
             ) -> tuple[list[Recording], list[Recording]]:
    """Return the Recordings of a cable for training, if any, and for evaluation; noise in m."""
    found: tuple[list[Recording], list[Recording]] = [], []
    for k in range(0 if trained else _TRAINING, _TRAINING + _EVALUATED):
        seed, part = 100 * number + k, int(k >= _TRAINING)
        clean = recording(CABLES[number], seed, _FRAMES if part else effort.window)
        rng = np.random.default_rng(seed)
        found[part].append(Recording(str(k), clean + noise * rng.standard_normal(clean.shape)))
    return found


HEADS = ['cable', 'engine', 'w L^3 / EI', 'found', 'damping a, b', 'found', 'covered',
         'misfit / noise', 'error [mm]', 'free markers [mm]', 'not predicted', 'fit [s]',
         'prediction of 5 s [s]']


def covered(made: Made, cable: deform.Cable) -> tuple[float, Array]:
    """Return the deviation of w L^3 / EI found, and all errors in deviations (3,)."""
    found, rod = softness(cable), cable.rod
    relative = np.ravel(cable.fit.deviations['bending_stiffness'])[0] / rod.stiffness[1]
    off = np.abs(np.array(cable.fit.values['damping']) - made.damping)
    return found * relative, np.array([
        abs(np.log(found / made.softness)) / relative,
        *off / np.array(cable.fit.deviations['damping'])])


def softness(cable: deform.Cable) -> float:
    """Return w L^3 / EI of a Cable."""
    rod = cable.rod
    weight = 9.81 * rod.node_masses(np.array([0.0, rod.length])).sum()
    return float(weight * rod.length**2 / rod.stiffness[1])


def line(number: int, cable: deform.Cable, score: deform.Score) -> list[str]:
    """Return the row of a cable under HEADS."""
    made = CABLES[number]
    spread, off = covered(made, cable)
    damping = ', '.join(f'{value:.2g} ± {one:.1g}' for value, one in zip(
        cable.fit.values['damping'], cable.fit.deviations['damping'], strict=True))
    return [str(number), 'MuJoCo' if made.bends else 'discrete rod', f'{made.softness:g}',
            f'{softness(cable):.1f} ± {spread:.1f}', f'{made.damping[0]:g}, {made.damping[1]:g}',
            damping, f'{(off <= _COVERED).sum()} of {off.size}', f'{cable.unexplained:.2f}',
            f'{1e3 * np.nanmean(score.errors):.2f}', f'{1e3 * np.nanmean(score.free):.2f}',
            f'{score.failed} of {len(score.names)}', f'{cable.seconds:.0f}',
            f'{np.median(score.seconds):.1f}']


BENT_HEADS = ['cable', 'natural curvature k_n, k_b [1/m] at 0, L/2, L', 'found', 'covered']


def bent(number: int, cable: deform.Cable) -> dict[str, Any]:
    """Return what JSON can hold of the natural curvature: 1/m at the knots, made and found."""
    made = CABLES[number]
    s = np.linspace(0, made.length, _KNOTS)
    return {'made': made.rod.natural_strains(s)[:, 1:].tolist(),
            'found': np.array(cable.fit.values['natural_curvature']).tolist(),
            'deviations': np.array(cable.fit.deviations['natural_curvature']).tolist()}


def bent_line(number: str, data: dict[str, Any]) -> list[str]:
    """Return the row of a cable under BENT_HEADS."""
    made, found, deviations = (np.array(data[key]) for key in ('made', 'found', 'deviations'))
    within = np.abs(found - made) <= _COVERED * deviations
    told = [', '.join(f'{value:.2f} ± {one:.2f}' for value, one in zip(*both, strict=True))
            for both in zip(found, deviations, strict=True)]
    return [number, '; '.join(f'{k_n:.2g}, {k_b:.2g}' for k_n, k_b in made), '; '.join(told),
            f'{within.sum()} of {within.size}']


def kept(folder: Path) -> tuple[dict[str, list[str]], dict[str, Any]]:
    """Return the rows under HEADS and the data of the cables in a folder's table, by number."""
    text, data = folder / 'deform_surrogate.md', folder / 'deform_surrogate.json'
    if not (text.exists() and data.exists()):
        return {}, {}
    table = [[cell.strip() for cell in line.strip('|').split('|')]
             for line in text.read_text().splitlines() if line.startswith('|')]
    if not table or table[0] != HEADS:
        return {}, {}
    found = json.loads(data.read_text())['deform_surrogate']
    return {cells[0]: cells for cells in table if len(cells) == len(HEADS) and cells[0] in found
            }, found


def write(folder: Path, rows: dict[str, list[str]], data: dict[str, Any]) -> None:
    """Write the tables of cables by number, after those that are in the folder already."""
    before, others = kept(folder)
    rows, data = {**before, **rows}, {**others, **data}
    text = report.markdown(HEADS, [rows[number] for number in sorted(rows)])
    bends = [bent_line(number, data[number]['natural_curvature']) for number in sorted(data)
             if 'natural_curvature' in data[number]]
    if bends:
        text += '\n' + report.markdown(BENT_HEADS, bends)
    report.write(folder, 'deform_surrogate', '# Cables of other engines', text,
                 {number: data[number] for number in sorted(data)})


def known(number: int, effort: deform.Effort) -> deform.Cable:
    """Return a Cable as it was made."""
    made = CABLES[number]
    return deform.Cable(made.rod, np.linspace(0, made.length, made.markers - 2), None, effort, 0.0)


def said(number: int, score: deform.Score) -> str:
    """Return a line that tells a Score."""
    return (f'cable {number}: error {1e3 * np.nanmean(score.errors):.2f} mm, of free markers '
            f'{1e3 * np.nanmean(score.free):.2f} mm, {score.failed} of {len(score.names)} not '
            f'predicted, {np.median(score.seconds):.1f} s each')


def main(arguments: list[str] | None = None) -> int:
    """Run it; return 0 if every recording could be predicted."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.deform_surrogate',
                                     description=__doc__.splitlines()[0])
    parser.add_argument('--cables', type=int, nargs='+', default=list(CABLES), choices=CABLES)
    parser.add_argument('--noise', type=float, default=1e-3, help='of the markers, m')
    parser.add_argument('--known', action='store_true', help='predict only, as they were made')
    parser.add_argument('--output', type=Path, help='folder for tables')
    given = parser.parse_args(arguments)
    effort = replace(deform.Effort(), motions=_TRAINING, knots=_KNOTS)
    failed = 0
    for number in given.cables:
        training, evaluated = recorded(number, given.noise, effort, not given.known)
        cable = known(number, effort) if given.known else deform.identified(training, effort)
        score = deform.scored(cable, evaluated)
        failed += score.failed
        print(said(number, score), flush=True)
        if given.known:
            continue
        row = line(number, cable, score)
        data = {**deform.as_json(cable, score), 'softness': CABLES[number].softness,
                'off_deviations': covered(CABLES[number], cable)[1].tolist(),
                'natural_curvature': bent(number, cable)}
        print(' | '.join(row), '|', ' | '.join(bent_line('', data['natural_curvature'])[1:]),
              flush=True)
        if given.output:
            write(given.output, {str(number): row}, {str(number): data})
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
