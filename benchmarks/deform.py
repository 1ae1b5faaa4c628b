# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Real cables held by two robots: identified from training recordings, then predicted for 5 s.

python -m benchmarks.deform --data CLONE [--cables 1 2 3 4 5] [--output FOLDER]

CLONE is your own copy of github.com/roahmlab/DEFORM (Chen et al., CoRL 2024, arXiv 2406.05931). It
has no license, so nothing of it comes with this package, and nothing is downloaded here.

Of each cable, stiffness, natural curvature along it and damping are found, each relative to its
weight. Then evaluation recordings are predicted from the clamped markers alone. The error is that
of their evaluation: the mean of |prediction - recording| over coordinates, markers (the clamped
ones count, with an error of 0) and the frames 2 to 501.
"""

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from benchmarks import report
from benchmarks.deform_data import DT, Array, Recording, arc_lengths, recordings
from dlo_planner import DirectSimulator, Fit, Observation, ObservedMotion, Rod, fit_rod

FOLDER = Path(__file__).parent.parent / 'docs' / 'benchmarks'
PUBLISHED = {1: 0.0103, 2: 0.0102, 3: 0.0100, 4: 0.0115}  # m, the best in their own logs
CABLES = 1, 2, 3, 4, 5
HORIZON = range(2, 502)   # frames that are predicted
_WEIGHT = 0.02            # kg/m, assumed: motions and shapes tell no more than ratios
_TWIST = 0.75             # GJ / EI of a round cable that keeps its volume
_SOFTNESSES = 1.0, 10.0, 100.0, 1000.0  # w L^3 / EI, from which the search begins
_KNOTS = 5                # of the natural curvature
_MESH = {'basis': 'local', 'n_elements': 48}
_SNAPSHOTS, _MOTIONS = 24, 4
_APART = 50               # frames between the snapshots of a recording at least
_WINDOW = 250             # frames of a motion in a fit
_STEP, _SEEN = 2, 10      # frames between the poses given, and between those compared
_FIRST_SEEN = 50          # frames after which a motion is compared: how it began is forgotten


@dataclass(frozen=True)
class Cable:
    """An identified cable.

    Attributes:
        rod: Rod of the free length
        s: (markers - 2,) m, of the markers from the second to the last but one
        fit: the Fit of motions
        seconds: that it took
    """

    rod: Rod
    s: Array
    fit: Fit
    seconds: float


def identified(found: list[Recording]) -> Cable:
    """Return the Cable of training Recordings.

    First from the calmest frames, as shapes at rest: stiffness and natural curvature; then from
    motions: stiffness and damping.
    """
    began = perf_counter()
    s = arc_lengths(found)
    at_rest = _at_rest(found, s)
    rod = _first_guess(s[-1], at_rest)
    knots = np.linspace(0, s[-1], _KNOTS)
    shaped = fit_rod(rod, at_rest, ('bending_stiffness', 'natural_curvature'), knots=knots,
                     loss='huber', **_MESH).rod
    shaped = replace(shaped, torsional_stiffness=_TWIST * shaped.bending_stiffness[0])
    picked = [found[k] for k in np.linspace(0, len(found) - 1, min(_MOTIONS, len(found)))
              .round().astype(int)]
    fit = fit_rod(shaped, motions=[_motion(one, s) for one in picked],
                  parameters=('bending_stiffness', 'damping'), loss='huber', **_MESH)
    return Cable(fit.rod, s, fit, perf_counter() - began)


def predicted(cable: Cable, one: Recording) -> tuple[Array | None, float]:
    """Return all markers (frames of HORIZON, markers, 3) in m as predicted, and the seconds.

    Of the recording, the clamped markers alone are read. None: the motion could not be simulated.
    """
    began = perf_counter()
    frames = range(0, min(HORIZON.stop, len(one.markers)))
    grippers, ends = one.held(cable.rod.length, frames)
    motion = DirectSimulator(cable.rod, **_MESH).simulate(grippers, DT, far_ends=ends)
    if not motion.converged:
        return None, perf_counter() - began
    shapes = motion.shapes[-len(frames):][HORIZON.start:]
    out = one.lifted(frames[HORIZON.start:])
    out[:, 2:-2] = [[shape.at(place).position for place in cable.s[1:-1]] for shape in shapes]
    return out, perf_counter() - began


@dataclass(frozen=True)
class Score:
    """Errors of the predictions of a cable.

    Attributes:
        names: of the recordings; errors: (k,) m of each, nan where there is no prediction
        free: (k,) the same over the markers that are not clamped
        seconds: (k,) of each prediction
    """

    names: tuple[str, ...]
    errors: Array
    free: Array
    seconds: Array

    @property
    def failed(self) -> int:
        """How many recordings could not be predicted."""
        return int(np.isnan(self.errors).sum())


def scored(cable: Cable, found: list[Recording]) -> Score:
    """Return the Score of evaluation Recordings."""
    errors, free, seconds = [], [], []
    for one in found:
        out, took = predicted(cable, one)
        seconds.append(took)
        if out is None:
            errors.append(np.nan)
            free.append(np.nan)
            continue
        away = np.abs(out - one.lifted(range(HORIZON.start, HORIZON.start + len(out))))
        errors.append(away.mean())
        free.append(away[:, 2:-2].mean())
    return Score(tuple(one.name for one in found), np.array(errors), np.array(free),
                 np.array(seconds))


def _at_rest(found: list[Recording], s: Array) -> list[Observation]:
    """Return Observations of the frames in which the free markers moved the least."""
    calm = []
    for index, one in enumerate(found):
        speeds = np.abs(np.gradient(one.markers[:, 2:-2], axis=0)).mean(axis=(1, 2))
        for first in range(0, len(speeds) - 1, _APART):
            frame = first + int(speeds[first:first + _APART].argmin())
            calm.append((speeds[frame], index, frame))
    out = []
    for _, index, frame in sorted(calm)[:_SNAPSHOTS]:
        one = found[index]
        (gripper,), (end,) = one.held(s[-1], range(frame, frame + 1), lead=False)
        out.append(Observation(gripper, one.markers[frame, 2:-2], s[1:-1], end))
    return out


def _first_guess(length: float, at_rest: list[Observation]) -> Rod:
    """Return the straight Rod, one of several softnesses, that is nearest to what was seen."""
    best, least = None, np.inf
    for softness in _SOFTNESSES:
        stiffness = _WEIGHT * 9.81 * length**3 / softness
        rod = Rod(length, _WEIGHT, stiffness, _TWIST * stiffness)
        simulator = DirectSimulator(rod, **_MESH)
        away = [_away(simulator, one) for one in at_rest]
        if np.mean(away) < least:
            best, least = rod, np.mean(away)
    return best


def _away(simulator: DirectSimulator, one: Observation) -> float:
    shape = simulator.solve(one.gripper, far_end=one.far_end)
    if not shape.converged:
        return simulator.rod.length
    places = np.array([shape.at(place).position for place in one.s])
    return float(np.linalg.norm(places - one.points, axis=1).mean())


def _motion(one: Recording, s: Array) -> ObservedMotion:
    """Return the beginning of a recording as a motion to be fitted."""
    frames = range(0, min(_WINDOW, len(one.markers)), _STEP)
    grippers, ends = one.held(s[-1], frames)
    before = len(grippers) - len(frames)
    seen = range(_FIRST_SEEN, frames[-1] + 1, _SEEN)
    times = DT * (_STEP * before + np.array(seen))
    return ObservedMotion(grippers, _STEP * DT, times, one.free(seen), s[1:-1], far_ends=ends)


HEADS = ['cable', 'error [mm]', 'published [mm]', 'free markers [mm]', 'worst recording [mm]',
         'not predicted', 'length [m]', 'w L^3 / EI', 'damping a, b', 'misfit of the fit [mm]',
         'fit [s]', 'prediction of 5 s [s]']


def line(number: int, cable: Cable, score: Score) -> list[str]:
    """Return the row of a cable under HEADS."""
    rod = cable.rod
    softness = rod.mass_per_length * 9.81 * rod.length**3 / rod.bending_stiffness[0]
    return [str(number), f'{1e3 * np.nanmean(score.errors):.2f}',
            f'{1e3 * PUBLISHED[number]:.1f}' if number in PUBLISHED else '-',
            f'{1e3 * np.nanmean(score.free):.2f}', f'{1e3 * np.nanmax(score.errors):.2f}',
            f'{score.failed} of {len(score.names)}', f'{rod.length:.4f}', f'{softness:.3g}',
            ', '.join(f'{value:.3g}' for value in rod.damping), f'{1e3 * cable.fit.misfit:.2f}',
            f'{cable.seconds:.0f}', f'{np.median(score.seconds):.2f}']


def as_json(cable: Cable, score: Score) -> dict:
    """Return what JSON can hold of a cable."""
    return {'length_m': cable.rod.length, 'stiffness_Nm2': cable.rod.bending_stiffness[0],
            'mass_per_length_kg_m': cable.rod.mass_per_length, 'damping': list(cable.rod.damping),
            'misfit_m': cable.fit.misfit, 'fit_s': cable.seconds,
            'errors_m': {name: None if np.isnan(value) else value for name, value in zip(
                score.names, score.errors.tolist(), strict=True)}}


def main(arguments: list[str] | None = None) -> int:
    """Run it; return 0 if every recording could be predicted."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.deform',
                                     description=__doc__.splitlines()[0])
    parser.add_argument('--data', type=Path, required=True, help='your clone of DEFORM')
    parser.add_argument('--cables', type=int, nargs='+', default=list(CABLES), choices=CABLES)
    parser.add_argument('--output', type=Path, default=FOLDER)
    given = parser.parse_args(arguments)
    lines, data, failed = [], {}, 0
    for number in given.cables:
        cable = identified(recordings(given.data, number, 'train'))
        score = scored(cable, recordings(given.data, number, 'eval'))
        failed += score.failed
        lines.append(line(number, cable, score))
        data[str(number)] = as_json(cable, score)
        print('  '.join(lines[-1]), flush=True)
    report.write(given.output, 'deform', '# Real cables', report.markdown(HEADS, lines), data)
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
