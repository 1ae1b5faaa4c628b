# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Three real wires, photographed and twisted by others: what the model explains, and what not.

python -m benchmarks.real_wires [FOLDER] [--only WIRE ...] [--output FOLDER]

FOLDER, or that of the environment variable DLO_WIRES, has `loop_{white,black,red}_{0..4}.csv`, x
and z in m of 51 points, evenly spaced along 1.5 m of a wire that hangs in a loop between two
clamps; both hold it level, in the same direction. `whitecrit.csv` and `whitelax.csv` are the white
wire, twisted, before and after it gave way. They are those of arXiv 2310.00911
(github.com/qj25/adapteddlo_muj).

Of each wire it tells

* the bending stiffness of each photograph, first in the grips as they are said to be (`fit_rod`),
  then with what a photograph does not tell as unknowns: by how much the camera is turned about its
  line of sight, and by how much the wire leaves either clamp in another direction than it has;
* whether the five agree within their deviations. Residuals of neighboring points go together, so
  there are fewer than they seem: deviations are widened by the root of how many do;
* how far the fifth photograph is from what the other four predict;
* at which twist of one clamp the loop gives way, and the torsional stiffness for which it is that
  measured.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from benchmarks import report
from dlo_planner import DirectSimulator, FarEnd, Pose, Rod, Shape, fit_rod
from dlo_planner.identify import Observation

VARIABLE = 'DLO_WIRES'
LENGTH, PHOTOS = 1.5, 5  # m; of each wire
GRAVITY = 9.81           # m/s^2
# Four times as many elements move the loop by 1.2 mm at most, and the twist that tips it by 0.6 %.
MESH = {'n_elements': 64, 'basis': 'local'}
APART = 0.1235           # m, of the clamps when the wires were twisted
POISSON = 0.3            # of nobody's measurement: GJ = EI / (1 + 0.3) where nothing else is known
_STEP, _FINE = 10.0, 2.5    # degrees of twist: steps, and the last of them
_MOST = 2000.0           # degrees
_WAY, _TRIES = 24, 6     # steps that lead the end round; of a search
_SETTLED = 1e-3          # m: a loop that is out of its plane by less has no twist


@dataclass(frozen=True)
class Wire:
    """What is known of a wire from its authors."""

    name: str
    mass: float                       # kg/m
    theirs: tuple[float, float]       # EI in N m^2 and GJ / EI, as they fitted them
    gives_way: tuple[float, float]    # degrees of twist, as they measured it


WIRES = (Wire('white', 0.087 / 5, (1.2166e-4, 0.7236), (970.0, 980.0)),
         Wire('black', 0.081 / 2.98, (1.1965e-3, 1.41), (470.0, 500.0)),
         Wire('red', 0.043 / 2, (9.297e-4, 1.57), (430.0, 470.0)))


def photographs(folder: Path, wire: Wire) -> list[np.ndarray]:
    """Return the points (51, 2) of each photograph of a wire, x and z in m."""
    return [np.loadtxt(folder / f'loop_{wire.name}_{k}.csv', delimiter=',', skiprows=1)
            for k in range(PHOTOS)]


def in_space(points: np.ndarray) -> np.ndarray:
    """Return points (m, 3) of those in a picture (m, 2)."""
    return np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])


def places(points: np.ndarray) -> np.ndarray:
    """Return the arc lengths (m,) of the points of a photograph, m."""
    return np.linspace(0.0, LENGTH, len(points))


def pitched(position: np.ndarray, angle: float) -> Pose:
    """Return a clamp at a position, that leads down by an angle (rad)."""
    return Pose(position, Rotation.from_euler('y', angle).as_quat())


def rod_of(wire: Wire, stiffness: float, ratio: float = 1 / (1 + POISSON)) -> Rod:
    """Return the Rod of a wire with EI (N m^2) and GJ / EI."""
    return Rod(LENGTH, wire.mass, stiffness, ratio * stiffness)


def loop(wire: Wire, apart: float = APART) -> Shape:
    """Return the loop in its plane, without twist, between level clamps `apart` (m).

    The far end is led there in the plane: round with an arc that closes to a circle.
    """
    simulator = DirectSimulator(rod_of(wire, wire.theirs[0]), **MESH)
    shape = None
    for turned in np.linspace(0.2, 2 * np.pi, _WAY):
        at = LENGTH / turned * np.array([np.sin(turned), 0.0, np.cos(turned) - 1.0])
        shape = simulator.solve(Pose.identity(), shape, far_end=FarEnd(pitched(at, turned)))
    for along in np.linspace(0.0, -apart, 4)[1:]:
        end = FarEnd(Pose((along, 0.0, 0.0), (0, 0, 0, 1)))
        shape = simulator.solve(Pose.identity(), shape, far_end=end)
    if not shape.converged or np.abs(shape.positions[:, 1]).max() > _SETTLED:
        raise RuntimeError(f'the loop of the {wire.name} wire was not found: {shape.status}')
    return shape


# ---- shapes --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Found:
    """What was found of photographs of one wire."""

    stiffness: float       # N m^2
    deviation: float       # of it, N m^2, widened for neighbors that go together
    apart: float           # root mean square distance of the points from the wire, m
    angles: np.ndarray     # (n, 3) rad: camera, begin and end of the wire; 0: as it is said


def as_it_is_said(wire: Wire, photos: Sequence[np.ndarray], first: Shape) -> Found:
    """Return what `fit_rod` finds in the grips as they are said to be."""
    seen = [Observation(Pose.identity(), in_space(points)[1:-1], places(points)[1:-1],
                        pitched(in_space(points)[-1], 0.0), (0, 1, 0), first) for points in photos]
    fit = fit_rod(first.rod, seen, **MESH)
    off = [line - points for line, points in zip(_at(fit.found, seen[0].s), fit.observed,
                                                 strict=True)]
    wider = np.sqrt(max(_together(one[:, k]) for one in off for k in (0, 2)))
    return Found(float(fit.values['bending_stiffness'][0]),
                 float(wider * fit.deviations['bending_stiffness'][0]), fit.misfit,
                 np.zeros((len(photos), 3)))


def _at(lines: Sequence[np.ndarray], s: np.ndarray) -> list[np.ndarray]:
    """Return (m, 3) places at `s` (m,) of wires whose nodes (n, 3) are evenly spaced."""
    return [np.column_stack([np.interp(s, np.linspace(0, LENGTH, len(line)), line[:, k])
                             for k in range(3)]) for line in lines]


def _together(off: np.ndarray) -> float:
    """Return how many neighboring residuals (m,) go together: the integral of their correlation."""
    off = off - off.mean()
    whole, count = float(off @ off), 1.0
    for lag in range(1, len(off)):
        share = float(off[:-lag] @ off[lag:]) / whole
        if share <= 0:
            break
        count += 2 * share
    return count


class Turned:
    """Photographs of one wire with what they do not tell: three angles of each, see Found."""

    def __init__(self, wire: Wire, photos: Sequence[np.ndarray], first: Shape) -> None:
        self.wire, self.photos = wire, photos
        self._near = [first] * len(photos)

    def shape(self, number: int, stiffness: float, angles: np.ndarray) -> Shape:
        """Return the wire of a photograph; `angles` (3,) rad."""
        camera, begin, end = angles
        gravity = GRAVITY * np.array([np.sin(camera), 0.0, -np.cos(camera)])
        simulator = DirectSimulator(rod_of(self.wire, stiffness), gravity=gravity, **MESH)
        points = in_space(self.photos[number])
        shape = simulator.solve(pitched(points[0], begin), self._near[number],
                                far_end=FarEnd(pitched(points[-1], end)))
        if shape.converged:
            self._near[number] = shape
        return shape

    def off(self, number: int, stiffness: float, angles: np.ndarray) -> np.ndarray:
        """Return (m, 2) by how much the wire is off the points inside, m."""
        points = self.photos[number]
        line = self.shape(number, stiffness, angles).positions_at(places(points))
        result: np.ndarray = (line[:, [0, 2]] - points)[1:-1]
        return result

    def found(self) -> Found:
        """Return what is found: one stiffness of all, the angles of each."""
        def residuals(x: np.ndarray) -> np.ndarray:
            angles = x[1:].reshape(-1, 3)
            return np.concatenate([self.off(k, np.exp(x[0]), one).ravel()
                                   for k, one in enumerate(angles)])
        begin = np.append(np.log(self.wire.theirs[0]), np.zeros(3 * len(self.photos)))
        found = least_squares(residuals, begin, diff_step=1e-4,
                              x_scale=np.append(0.1, np.full(begin.size - 1, 0.02)))
        each = found.fun.reshape(len(self.photos), -1, 2)
        wider = max(_together(one[:, k]) for one in each for k in (0, 1))
        spread = np.linalg.inv(found.jac.T @ found.jac)[0, 0] * wider * (
            2 * found.cost / (found.fun.size - begin.size))
        stiffness = float(np.exp(found.x[0]))
        return Found(stiffness, stiffness * float(np.sqrt(spread)),
                     float(np.sqrt(np.mean(np.sum(each**2, axis=2)))),
                     found.x[1:].reshape(-1, 3))


def agreement(each: Sequence[Found]) -> tuple[float, float]:
    """Return the spread of the stiffnesses as a part of their mean, and chi-square per freedom."""
    values, spread = (np.array([getattr(one, name) for one in each])
                      for name in ('stiffness', 'deviation'))
    mean = np.sum(values / spread**2) / np.sum(1 / spread**2)
    return (float(values.std(ddof=1) / values.mean()),
            float(np.sum(((values - mean) / spread)**2) / (len(each) - 1)))


def rms(off: np.ndarray) -> float:
    """Return the root mean square length of vectors (m, 2)."""
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


# ---- twist ---------------------------------------------------------------------------------------


def twist_that_tips(wire: Wire, stiffness: float, ratio: float,
                    first: Shape) -> tuple[float, Shape, Shape]:
    """Return the twist of one clamp, in degrees, at which the loop gives way, before and after it.

    nan where it does not below 2000 degrees.
    """
    simulator = DirectSimulator(rod_of(wire, stiffness, ratio), **MESH)

    def turned(angle: float, before: Shape) -> Shape:
        quaternion = Rotation.from_euler('x', angle, degrees=True).as_quat()
        return simulator.solve(Pose.identity(), before,
                               far_end=FarEnd(Pose(first.positions[-1], quaternion)))

    shape, at, step = turned(0.0, first), 0.0, _STEP
    while at < _MOST:
        there = turned(at + step, shape)
        if there.converged and not there.jumped:
            shape, at = there, at + step
        elif step > _FINE:
            step *= 0.5
        else:
            return at + 0.5 * step, shape, there
    return np.nan, shape, shape


def torsion_for(wire: Wire, stiffness: float, first: Shape) -> tuple[float, float, float]:
    """Return GJ / EI with which the loop gives way as measured, the twist there, a deviation.

    The twist is nearly in proportion to EI / GJ; the deviation is that of half the measured range.
    """
    low, high = wire.gives_way
    wanted = 0.5 * (low + high)
    ratio, before = wire.theirs[1], None
    for _ in range(_TRIES):
        twist, *_ = twist_that_tips(wire, stiffness, ratio, first)
        if abs(twist - wanted) <= _FINE:
            break
        slope = -twist / ratio if before is None else (twist - before[1]) / (ratio - before[0])
        before = ratio, twist
        ratio += (wanted - twist) / slope
    slope = -twist / ratio
    return ratio, twist, abs((high - low) / 2 / slope)


# ---- all of it -----------------------------------------------------------------------------------


def studied(wire: Wire, folder: Path) -> tuple[list[str], list[list[str]]]:
    """Return what there is to say of a wire, in lines and as the rows of a table."""
    photos = photographs(folder, wire)
    first, name = loop(wire), wire.name
    lines, rows = [], [[f'photograph {k + 1}'] for k in range(PHOTOS)] + [
        ['all five together'], ['scatter of the five; chi-square per degree of freedom'],
        ['photograph 5 predicted from 1 to 4']]
    for how, find in (('as it is said', lambda some: as_it_is_said(wire, some, first)),
                      ('angles found', lambda some: Turned(wire, some, first).found())):
        each, whole, most = [find([one]) for one in photos], find(photos), find(photos[:-1])
        spread, chi = agreement(each)
        last = Turned(wire, photos[-1:], first)
        missed = 1e3 * rms(last.off(0, most.stiffness, most.angles.mean(axis=0)))
        lines += [
            *(f'{name}, {how}, photograph {k + 1}: EI {_said(one)}, {_apart(one)}{_angles(one)}'
              for k, one in enumerate(each)),
            f'{name}, {how}, all: EI {_said(whole)}, {_apart(whole)}{_angles(whole)}; the five '
            f'scatter by {100 * spread:.1f} %, chi-square {chi:.2f} per degree of freedom',
            f'{name}, {how}, photograph 5 from the others: {missed:.1f} mm off']
        for row, one in zip(rows, [*each, whole], strict=False):
            row += [f'{_said(one)}, {_apart(one)}']
        rows[-2] += [f'{100 * spread:.1f} %; {chi:.2f}']
        rows[-1] += [f'{missed:.1f} mm off']
    alike = 1e3 * rms((photos[-1] - np.mean(photos[:-1], axis=0))[1:-1])
    lines.append(f'{name}, photograph 5 is {alike:.1f} mm off the mean of the others')
    rows.append(['photograph 5 from the mean of the points of 1 to 4', f'{alike:.1f} mm', ''])
    low, high = wire.gives_way
    for how, stiffness, ratio in (("the authors' EI and GJ", *wire.theirs),
                                  (f'EI found, GJ = EI / {1 + POISSON:g}', whole.stiffness,
                                   1 / (1 + POISSON))):
        twist, *_ = twist_that_tips(wire, stiffness, ratio, first)
        away = 100 * abs(2 * twist / (low + high) - 1)
        lines.append(f'{name}, {how}: gives way at {twist:.0f} degrees, measured {low:g} to '
                     f'{high:g}, {away:.1f} % off')
        rows.append([f'gives way, {how}', f'{twist:.0f} degrees, {away:.0f} % off',
                     f'measured: {low:g} to {high:g}'])
    ratio, twist, doubt = torsion_for(wire, whole.stiffness, first)
    lines.append(f'{name}: GJ = ({ratio:.3f} +- {doubt:.3f}) EI gives way at {twist:.0f} degrees; '
                 f'the authors have {wire.theirs[1]:g} EI')
    rows.append(['GJ with which it gives way as measured', f'({ratio:.3f} ± {doubt:.3f}) EI found',
                 f'the authors: {wire.theirs[1]:g} EI'])
    _, before, after = twist_that_tips(wire, whole.stiffness, ratio, first)
    for when, file, shape in (('before', 'crit', before), ('after', 'lax', after)):
        if (path := folder / f'{name}{file}.csv').is_file():
            points = np.loadtxt(path, delimiter=',', skiprows=1)
            off = 1e3 * rms(shape.positions_at(places(points))[:, [0, 2]] - points)
            lines.append(f'{name}, {when} it gives way: {off:.1f} mm off the photograph')
            rows.append([f'shape just {when} it gives way', f'{off:.1f} mm off', ''])
    return lines, rows


def _said(found: Found) -> str:
    return f'{1e4 * found.stiffness:.3f} ± {1e4 * found.deviation:.3f} e-4 N m^2'


def _apart(found: Found) -> str:
    return f'{1e3 * found.apart:.1f} mm off'


def _angles(found: Found) -> str:
    """Say how far camera, begin and end are turned, where that was looked for."""
    angles = ' / '.join(f'{one:.1f}' for one in np.rad2deg(found.angles.mean(axis=0)))
    return f', camera / begin / end {angles} degrees' if found.angles.any() else ''


def main(arguments: list[str] | None = None) -> int:
    """Print what there is to say of each wire."""
    parser = argparse.ArgumentParser(prog='benchmarks.real_wires',
                                     description=__doc__.splitlines()[0])
    parser.add_argument('folder', nargs='?', default=os.environ.get(VARIABLE),
                        help=f'of the photographs; by default that of {VARIABLE}')
    parser.add_argument('--only', nargs='+', choices=[one.name for one in WIRES],
                        default=[one.name for one in WIRES], help='some wires')
    parser.add_argument('--output', type=Path, help='folder for the tables, of the site for its')
    given = parser.parse_args(arguments)
    if given.folder is None or not (Path(given.folder) / 'loop_white_0.csv').is_file():
        print(f'{VARIABLE} = {given.folder}: expected a folder with loop_white_0.csv and the like; '
              'nothing was measured', file=sys.stderr)
        return 2
    for wire in WIRES:
        if wire.name in given.only:
            lines, rows = studied(wire, Path(given.folder))
            print('\n'.join(lines), flush=True)
            if given.output:
                heads = [f'{wire.name} wire', 'grips as they are said',
                         'angles of camera and wire found']
                report.write(given.output, f'real_wires_{wire.name}', f'# The {wire.name} wire',
                             report.markdown(heads, rows), {'lines': lines})
    return 0


if __name__ == '__main__':
    sys.exit(main())
