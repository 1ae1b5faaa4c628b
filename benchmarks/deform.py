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
import pickle
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any, BinaryIO

import numpy as np

from benchmarks import report
from benchmarks.deform_data import DT, Array, Recording, arc_lengths
from benchmarks.deform_doubt import doubted
from dlo_planner import DirectSimulator, Rod, fit_rod
from dlo_planner.identify import Fit, ObservedMotion

FOLDER = Path(__file__).parent.parent / 'docs' / 'benchmarks'
PUBLISHED = {1: 0.0103, 2: 0.0102, 3: 0.0100, 4: 0.0115}  # m, the best in their own logs
CABLES = 1, 2, 3, 4, 5
HORIZON = range(2, 502)   # frames that are predicted
_WEIGHT = 0.02            # kg/m, assumed: motions tell no more than ratios
_TWIST = 0.75             # GJ / EI of a round cable that keeps its volume
_DAMPING = 0.5, 0.0       # 1/s and s, from which the search begins
_SOFTNESSES = 2.0, 6.0, 20.0, 60.0, 200.0  # w L^3 / EI, one of which the search begins with
_STEPS = 8, 4             # frames between the poses given: at first, then; every second is seen
_COARSE = {'basis': 'local', 'n_elements': 20}  # of the first of them
_ROUGHLY = 1e-2           # of the length: error of motions from which the first guess is chosen
_FIRST_SEEN = 48          # frames after which a motion is compared: how it began is forgotten
_ROUNDS = 2               # of doubts and fit
_LEAST = 100              # frames of a recording for training
_UNREADABLE = ValueError, TypeError, EOFError, IndexError, AttributeError, pickle.UnpicklingError
_ALLOWED = {('builtins', name) for name in ('list', 'tuple', 'float', 'int')} | {
    (f'numpy.{core}.{module}', name) for core in ('core', '_core')
    for module, name in (('multiarray', '_reconstruct'), ('multiarray', 'scalar'),
                         ('numeric', '_frombuffer'))} | {('numpy', 'ndarray'), ('numpy', 'dtype')}


@dataclass(frozen=True)
class Effort:
    """How much of the training recordings is used.

    Attributes:
        motions: number of recordings, evenly picked
        window: frames of each
        knots: number of places along the cable between which natural curvature is straight
        elements: of the cable
    """

    motions: int = 4
    window: int = 300
    knots: int = 4
    elements: int = 32

    @property
    def mesh(self) -> dict[str, Any]:
        """Options of the `DirectSimulator`."""
        return {'basis': 'local', 'n_elements': self.elements}


@dataclass(frozen=True)
class Cable:
    """An identified cable.

    Attributes:
        rod: Rod of the free length
        s: (markers - 2,) m, of the markers from the second to the last but one
        fit: the Fit of motions
        effort: with which it was found
        seconds: that it took
    """

    rod: Rod
    s: Array
    fit: Fit
    effort: Effort
    seconds: float

    @property
    def unexplained(self) -> float:
        """What the fit leaves, in deviations of the noise: far above 1, the model is not right."""
        return self.fit.misfit / (np.sqrt(3) * self.fit.noise)


def identified(found: list[Recording], effort: Effort = Effort()) -> Cable:  # noqa: B008  frozen
    """Return the Cable of training Recordings.

    First stiffness and damping of a straight cable, then natural curvature along it with them, and
    with all that the recordings leave in doubt. How far that moves the markers depends on the
    cable, and is found again with the one that was found.
    """
    began = perf_counter()
    s = arc_lengths(found)
    picked = np.linspace(0, len(found) - 1, min(effort.motions, len(found))).round().astype(int)
    coarse, fine = ([(found[k], range(0, min(effort.window, len(found[k].markers)), step))
                     for k in picked] for step in _STEPS)
    motions = [_motion(*one, s) for one in coarse]
    straight = fit_rod(_first_guess(s[-1], motions, effort), motions=motions[:1],
                       parameters=('bending_stiffness', 'damping'), **_COARSE).rod
    rod = replace(straight, torsional_stiffness=_TWIST * float(straight.stiffness[1]))
    for _ in range(_ROUNDS):
        fit = refined(rod, fine, s, effort)
        rod = fit.rod
    return Cable(fit.rod, s, fit, effort, perf_counter() - began)


def refined(rod: Rod, seen: list[tuple[Recording, range]], s: Array, effort: Effort) -> Fit:
    """Return the Fit of frames of Recordings from a Rod on, with what is in doubt with that Rod."""
    direct = DirectSimulator(rod, **effort.mesh)
    motions = [doubted(_motion(*one, s), *one, direct) for one in seen]
    noise = float(np.sqrt(np.mean([one.noise**2 for one, _ in seen])))
    return fit_rod(rod, motions=motions, knots=np.linspace(0, s[-1], effort.knots), noise=noise,
                   parameters=('bending_stiffness', 'damping', 'natural_curvature'), **effort.mesh)


def predicted(cable: Cable, one: Recording) -> tuple[Array | None, float]:
    """Return all markers (frames of HORIZON, markers, 3) in m as predicted, and the seconds.

    Of the recording, the clamped markers alone are read. None: the motion could not be simulated.
    """
    began = perf_counter()
    frames = range(0, min(HORIZON.stop, len(one.markers)))
    grippers, ends = one.held(cable.rod.length, frames)
    motion = DirectSimulator(cable.rod, **cable.effort.mesh).simulate(grippers, DT, far_ends=ends)
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


def _first_guess(length: float, motions: list[ObservedMotion], effort: Effort) -> Rod:
    """Return the straight Rod, one of several softnesses, that moves most like what was seen."""
    rods, away = [], []
    for softness in _SOFTNESSES:
        stiffness = _WEIGHT * 9.81 * length**3 / softness
        rods.append(Rod(length, _WEIGHT, stiffness, _TWIST * stiffness, damping=_DAMPING))
        direct = DirectSimulator(rods[-1], **effort.mesh)
        away.append(np.mean([_away(direct, one) for one in motions]))
    return rods[int(np.argmin(away))]


def _away(direct: DirectSimulator, one: ObservedMotion) -> float:
    """Return the mean distance of the markers from a cable that is moved as one was seen, m."""
    motion = direct.simulate(one.grippers, one.dt, far_ends=one.far_ends,
                             tolerance=_ROUGHLY * direct.rod.length)
    if not motion.converged:
        return direct.rod.length
    shapes = [motion.shapes[k] for k in (one.times / one.dt).round().astype(int)]
    places = np.array([[shape.at(place).position for place in one.s] for shape in shapes])
    return float(np.linalg.norm(places - one.points, axis=2).mean())


def _motion(one: Recording, frames: range, s: Array) -> ObservedMotion:
    """Return frames of a recording as a motion to be fitted."""
    grippers, ends = one.held(s[-1], frames)
    before = len(grippers) - len(frames)
    seen = range(_FIRST_SEEN, frames[-1] + 1, 2 * frames.step)
    times = DT * (frames.step * before + np.array(seen))
    return ObservedMotion(grippers, frames.step * DT, times, one.free(seen), s[1:-1], far_ends=ends)


HEADS = ['cable', 'error [mm]', 'published [mm]', 'free markers [mm]', 'worst recording [mm]',
         'not predicted', 'length [m]', 'w L^3 / EI', 'damping a, b', 'misfit / noise',
         'fit [s]', 'prediction of 5 s [s]']


def line(number: int, cable: Cable, score: Score) -> list[str]:
    """Return the row of a cable under HEADS."""
    rod = cable.rod
    weight = 9.81 * rod.node_masses(np.array([0.0, rod.length])).sum()
    softness = weight * rod.length**2 / rod.stiffness[1]
    return [str(number), f'{1e3 * np.nanmean(score.errors):.2f}',
            f'{1e3 * PUBLISHED[number]:.1f}' if number in PUBLISHED else '-',
            f'{1e3 * np.nanmean(score.free):.2f}', f'{1e3 * np.nanmax(score.errors):.2f}',
            f'{score.failed} of {len(score.names)}', f'{rod.length:.4f}', f'{softness:.3g}',
            ', '.join(f'{value:.3g}' for value in np.ravel(rod.damping)),
            f'{cable.unexplained:.2f}',
            f'{cable.seconds:.0f}', f'{np.median(score.seconds):.2f}']


# ---- files of the data set -------------------------------------------------------------------
# `data_set/DLOk/train/*.pkl` and `eval/*.pkl`, as their public code reads them (`train_DEFORM.py`):
# a sequence over time of x, y, z (3 rows, m, z up) of 13 markers on cable 1, of 12 on the others.


class _NumbersOnly(pickle.Unpickler):
    """Reads arrays, lists and numbers; a pickle can ask for any code, which is refused."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ('_codecs', 'encode'):
            return _encoded
        if (module, name) not in _ALLOWED:
            raise pickle.UnpicklingError(f'expected numbers only, found {module}.{name}')
        return super().find_class(module, name)


def _encoded(text: str, encoding: str) -> bytes:
    """Return the bytes of an array as files of protocol 2 write them."""
    if encoding != 'latin1':
        raise pickle.UnpicklingError(f'expected bytes as latin1, found {encoding}')
    return text.encode(encoding)


def load(file: BinaryIO) -> Array:
    """Return the markers (frames, markers, 3) in m of a recording.

    Raises:
        ValueError: the file holds anything else, or markers are lost
        pickle.UnpicklingError: it asks for more than numbers
    """
    found = np.array(_NumbersOnly(file, encoding='latin1').load(), dtype=float)
    if found.ndim != 3 or found.shape[1] != 3 or found.shape[2] < 6:
        raise ValueError(f'a recording has shape {found.shape}: expected (frames, 3, markers), at '
                         'least 6 markers')
    found = np.ascontiguousarray(found.swapaxes(1, 2))
    lost = np.argwhere(~np.isfinite(found).all(axis=2))
    if len(lost):
        raise ValueError(f'marker {lost[0, 1]} is lost in frame {lost[0, 0]}')
    return found


def recordings(root: Path, cable: int, part: str, least: int = 4) -> list[Recording]:
    """Return the Recordings of a cable (1 to 5), of `least` frames or more.

    Args:
        root: of the clone
        part: 'train' or 'eval'

    Raises:
        FileNotFoundError: there are none
        ValueError: a file is not a recording; the message names it
    """
    folder = root / 'data_set' / f'DLO{cable}' / part
    paths = sorted(folder.glob('*.pkl'), key=lambda path: (len(path.stem), path.stem))
    if not paths:
        raise FileNotFoundError(f'{folder}: expected recordings, files *.pkl')
    out = []
    for path in paths:
        try:
            with path.open('rb') as file:
                markers = load(file)
            if len(markers) < least:
                raise ValueError(f'{len(markers)} frames: expected {least} or more')
        except _UNREADABLE as error:
            raise ValueError(f'{path}: {error}') from error
        out.append(Recording(path.stem, markers))
    return out


def as_json(cable: Cable, score: Score) -> dict[str, Any]:
    """Return what JSON can hold of a cable."""
    return {'length_m': cable.rod.length, 'stiffness_Nm2': float(cable.rod.stiffness[1]),
            'mass_per_length_kg_m': _WEIGHT, 'damping': np.ravel(cable.rod.damping).tolist(),
            'misfit_m': cable.fit.misfit, 'noise_m': cable.fit.noise, 'fit_s': cable.seconds,
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
    try:  # all of them first: a fit takes minutes
        found = {number: (recordings(given.data, number, 'train', _LEAST),
                          recordings(given.data, number, 'eval', HORIZON.stop))
                 for number in given.cables}
    except (OSError, ValueError) as error:
        parser.error(str(error))
    lines, data, failed = [], {}, 0
    for number, (training, evaluated) in found.items():
        cable = identified(training)
        score = scored(cable, evaluated)
        failed += score.failed
        lines.append(line(number, cable, score))
        data[str(number)] = as_json(cable, score)
        print('  '.join(lines[-1]), flush=True)
    report.write(given.output, 'deform', '# Real cables', report.markdown(HEADS, lines), data)
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
