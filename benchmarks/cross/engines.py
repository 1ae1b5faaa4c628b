# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A scene by this package and by MuJoCo: places (k, n, 3) at k instants and n arc lengths.

MuJoCo has a chain of rigid pieces (`dlo_planner.cell`), which shares no code with the simulators.
"""

from dataclasses import dataclass
from functools import partial
from math import ceil, pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmarks.cross.scenes import MOTION, STATIC, Scene
from dlo_planner import DirectSimulator
from dlo_planner.errors import NotConverged

if TYPE_CHECKING:
    from dlo_planner.cell.plant import Plant

Floats = NDArray[np.float64]
_SAMPLES = 41
_CALM, _CALM_FOR, _LONGEST = 1e-6, 0.25, 20.0  # m in s: what moves no more is at rest; s
_QUITE_CALM = 0.4  # damping ratio of the slowest vibration where only the rest is wanted


@dataclass(frozen=True)
class Found:
    """Places (k, n, 3) in m, and the error in m that the engine itself states."""

    places: Floats
    estimate: float


def arcs(scene: Scene) -> Floats:
    """Return the arc lengths at which shapes are compared, m."""
    return np.linspace(0, scene.rod.length, _SAMPLES)


def by_package(scene: Scene) -> Found:
    """Return the shapes of this package, with its default settings.

    Raises:
        NotConverged: it does not vouch for what it found
    """
    simulator, s = DirectSimulator(scene.rod, obstacles=scene.obstacles), arcs(scene)
    if scene.kind == MOTION:
        grippers = scene.grippers
        motion = simulator.simulate(grippers, scene.interval, simulator.solve(grippers[0]))
        if not motion.converged:
            raise NotConverged(f'{scene.name}: {motion.message}')
        return Found(np.array([shape.positions_at(s) for shape in motion.shapes]),
                     float(motion.error_estimate[-1]))
    # both engines begin with a DLO that hangs freely, through the hole
    hanging = DirectSimulator(scene.rod).solve(scene.way(0.0))
    shape = simulator.track(scene.grippers, initial=hanging)[-1]
    if not shape.converged:
        raise NotConverged(f'{scene.name}: {shape.status}')
    return Found(shape.positions_at(s)[None], shape.error_estimate)


def by_mujoco(scene: Scene, cells: int, step: float) -> Floats:
    """Return the places (k, n, 3) of a chain of cells, with steps of time in s."""
    from dlo_planner.cell.plant import Plant  # noqa: PLC0415  an extra

    s, first = arcs(scene), scene.way(0.0)
    start = partial(Plant, scene.rod, first, scene.obstacles, cells=cells, step=step)
    plant = start(damping=_QUITE_CALM)
    if scene.kind == STATIC:
        return plant.points(s)[None]
    if scene.kind == MOTION:
        # damping and stiffness in the ratio that the rod states
        plant = start(damping=pi * plant.frequencies[0] * scene.rod.damping[1])
    places = [plant.points(s)]
    parts = ceil(scene.interval / step - 1e-9)
    for k in range(round(scene.seconds / scene.interval)):
        for part in range(1, parts + 1):
            plant.move(scene.way((k + part / parts) * scene.interval), scene.interval / parts)
        places.append(plant.points(s))
    return np.array(places) if scene.kind == MOTION else _at_rest(plant, scene, s)[None]


def _at_rest(plant: 'Plant', scene: Scene, s: Floats) -> Floats:
    """Return the places (n, 3) when nothing moves any more.

    Raises:
        NotConverged: something goes on moving
    """
    last, before = scene.way(scene.seconds), plant.points(s)
    for _ in range(ceil(_LONGEST / _CALM_FOR)):
        plant.move(last, _CALM_FOR)
        now = plant.points(s)
        if np.abs(now - before).max() < _CALM:
            return now
        before = now
    raise NotConverged(f'{scene.name}: the chain of MuJoCo does not come to rest')
