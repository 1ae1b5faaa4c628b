# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One second of a moving wire, beside MuJoCo's chain of 40 pieces with steps of 2 ms.

python -m benchmarks.motions

The paper's wire goes aside and down by 0.1 m and back: freely, over a floor that it does not
touch, and onto floors. Both are timed in turns in one process, the motion alone: CPU time, the
least of several. Errors are distances of nodes from what the own engine's meshes and steps lead to
in the limit (ours 160 elements, tolerance 1e-5 m; MuJoCo's by Richardson from 40 and 80 pieces),
and how far these limits are apart is said: contacts of MuJoCo are soft.

A second table is of two motions on many points, those of `benchmarks.moving`: a level cable is let
fall on a floor, and one that lies on a table is drawn over it. There both are compared at equal
error: ours are the elements and the tolerance, of those tried, that take least and are no worse
than MuJoCo's. Limits are 128 elements, tolerance 1e-4 m, and 80 pieces, steps of 1 ms. The last
columns are of the default: CPU time of a second, its true error, and its `error_estimate`.
"""

from time import process_time

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks import moving, report
from benchmarks.cases import level, wire
from benchmarks.scenes import GRAVITY
from dlo_planner import DirectSimulator, Plane, Pose
from dlo_planner.cell.chain import set_rest
from dlo_planner.cell.plant import Plant

FLOORS = {'free': None, 'floor in reach, never touched': 0.05, 'touching': 0.195}
DAMPING, S = 5e-4, np.linspace(0, 1, 41)
_DT, _STEP = 0.01, 2e-3
THEIRS = (20, 2e-3), (40, 2e-3)  # pieces, step in s
OURS = (32, 1e-2), (32, 1e-3), (64, 1e-3)  # elements, tolerance in m


def way(time):
    """Return the gripper at a time in s."""
    moved = 0.1 * np.sin(np.pi * time) ** 2
    return level(1.0 - moved, moved)


def ours(height, elements=40, tolerance=None):
    """Return (CPU s, places (101, 41, 3)) of this package."""
    floor = [] if height is None else [Plane((0, 0, height), (0, 0, 1))]
    simulator = DirectSimulator(wire(damping=(0.0, DAMPING)), basis='local', n_elements=elements,
                                obstacles=floor)
    grippers = [way(_DT * k) for k in range(101)]
    start = simulator.solve(grippers[0])
    began = process_time()
    motion = simulator.simulate(grippers, _DT, start, tolerance=tolerance)
    seconds = process_time() - began
    assert motion.converged, motion.message
    return seconds, np.array([shape.positions_at(S) for shape in motion.shapes])


def theirs(height, cells=40, step=_STEP):
    """Return the same of MuJoCo's chain."""
    floor = [] if height is None else [Plane((0, 0, height), (0, 0, 1))]
    plant = Plant(wire(), way(0.0), floor, cells=cells, step=step)
    plant = Plant(wire(), way(0.0), floor, cells=cells, step=step,
                  damping=np.pi * plant.frequencies[0] * DAMPING)
    return moved(plant, lambda time: way(_DT * time), 100, round(_DT / step), step)


def moved(plant, pose_at, intervals, parts, step):
    """Return (CPU s, places (n, 41, 3)) of a plant that is led to `pose_at(interval)`."""
    places, seconds = [plant.points(S)], 0.0
    for k in range(intervals):
        poses = [pose_at(k + part / parts) for part in range(1, parts + 1)]
        began = process_time()
        for pose in poses:
            plant.move(pose, step)
        seconds += process_time() - began
        places.append(plant.points(S))
    return seconds, np.array(places)


def apart(one, other):
    """Return the largest distance of places (k, n, 3), m."""
    return float(np.linalg.norm(one - other, axis=2).max())


def line(name, height):
    """Return the cells of a row."""
    both = [(ours(height), theirs(height)) for _ in range(4)][1:]
    own, other = both[0][0][1], both[0][1][1]
    limit = ours(height, 160, 1e-5)[1]
    finer = theirs(height, 80, _STEP / 2)[1]
    other_limit = finer + (finer - other) / 3
    seconds = [min(pair[which][0] for pair in both) for which in (0, 1)]
    return [name, *(f'{1e3 * one:.0f} ms' for one in seconds), f'{seconds[0] / seconds[1]:.2f}',
            *(f'{1e3 * one:.2f} mm' for one in (apart(own, limit), apart(other, other_limit),
                                                apart(limit, other_limit)))]


class Laid(Plant):
    """A chain that begins with the shape of a `moving.Scene`, whatever it touches there."""

    def __init__(self, scene, cells, step):
        self._scene = scene
        super().__init__(scene.rod, scene.poses[0], scene.bodies, cells=cells, step=step)

    def _settle(self):
        start, chain = self._scene.start, self._chain
        edges = np.linspace(0, 1, len(chain.masses) + 1) * chain.length
        turned = np.vstack([np.zeros(3), np.cumsum(
            start.element_strains * np.diff(start.s)[:, None], axis=0)])
        angles = np.diff([[np.interp(s, start.s, one) for one in turned.T] for s in edges], axis=0)
        set_rest(self._model, chain, angles)
        self._data.qpos[7:] = self._model.qpos_spring[7:]
        set_rest(self._model, chain, chain.rest)
        self._place(*self._held)
        mujoco.mj_forward(self._model, self._data)

    def _damp(self, ratio):
        self.lag = 0.5 * self._step  # as little as the engine can

    def _check_free(self):
        """Accept what touches at first."""


def in_contact(name, elements=None, tolerance=None):
    """Return (CPU s, places (101, 41, 3), Motion) of one in `moving.NAMED`; None: the default."""
    mesh = {} if elements is None else {'basis': 'local', 'n_elements': elements}
    scene = moving.NAMED[name](mesh)
    direct = DirectSimulator(scene.rod, obstacles=scene.bodies, gravity=GRAVITY, **mesh)
    began = process_time()
    motion = direct.simulate(scene.poses, moving.DT, scene.start, tolerance=tolerance)
    seconds = process_time() - began
    assert motion.converged, motion.message
    return seconds, np.array([shape.positions_at(S) for shape in motion.shapes]), motion


def their_contact(scene, cells, step):
    """Return (CPU s, places) of MuJoCo's chain in a `moving.Scene`."""
    where = np.array([pose.position for pose in scene.poses])
    spline, last = CubicSpline(np.arange(len(where)), where), len(where) - 1
    return moved(Laid(scene, cells, step), lambda time: Pose(
        spline(time), scene.poses[min(int(np.ceil(time)) - 1, last)].quaternion), last,
        round(moving.DT / step), step)


def lines_in_contact(name):
    """Yield the rows of a motion on many points, one for each of THEIRS."""
    scene = moving.NAMED[name]({})
    limit = in_contact(name, 128, 1e-4)[1]
    other_limit = their_contact(scene, 80, 1e-3)[1]
    usual = min((in_contact(name) for _ in range(2)), key=lambda one: one[0])
    began = process_time()
    estimate = usual[2].error_estimate.max()
    default = [f'{usual[0]:.2f} s', f'{1e3 * apart(usual[1], limit):.2f} mm',
               f'{1e3 * estimate:.2f} mm in {process_time() - began:.2f} s']
    tried = [(*min((in_contact(name, *how) for _ in range(2)), key=lambda one: one[0])[:2], how)
             for how in OURS]
    for cells, step in THEIRS:
        seconds, places = min((their_contact(scene, cells, step) for _ in range(2)),
                              key=lambda one: one[0])
        error = apart(places, other_limit)
        own = min((one for one in tried if apart(one[1], limit) <= error), key=lambda one: one[0])
        yield [f'{name}, {cells} pieces, {1e3 * step:g} ms', f'{seconds:.2f} s',
               f'{1e3 * error:.2f} mm', '{} elements, {:g} m'.format(*own[2]), f'{own[0]:.2f} s',
               f'{1e3 * apart(own[1], limit):.2f} mm', f'{own[0] / seconds:.2f}',
               f'{1e3 * apart(limit, other_limit):.2f} mm', *default]


def main():
    """Print the tables."""
    heads = ['1 s of the wire', 'ours', 'MuJoCo', 'ours / MuJoCo', 'our error', 'its error',
             'limits apart']
    print(report.markdown(heads, [line(*one) for one in FLOORS.items()]))
    heads = ['1 s in contact, MuJoCo', 'takes', 'error', 'ours', 'takes', 'error',
             'ours / MuJoCo', 'limits apart', 'default', 'error', 'error_estimate']
    print()
    print(report.markdown(heads, [one for name in moving.NAMED for one in lines_in_contact(name)]))


if __name__ == '__main__':
    main()
