# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motions that the tests of calm trajectories share: from a start pose through the hole."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose, Rod, Trajectory
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import concatenate
from dlo_planner.plan.requirements import Limits
from dlo_planner.trajectory.calm_search import leg_tasks
from dlo_planner.trajectory.modal_response import slowest_period

CONFIG = Path(__file__).parent.parent / 'config'


def described(name):
    """Return what a file in config/ says of its rod, as a dict."""
    file = yaml.safe_load((CONFIG / f'{name}.yaml').read_text())
    told = dict(file['/**']['ros__parameters']['rod'])
    del told['name'], told['section']
    # YAML 1.1 takes 8.0e6 for a word
    return {key: float(value) if isinstance(value, str) else value for key, value in told.items()}


def damped(rod, ratio=0.01):
    """Return a Rod with a damping ratio of its slowest vibration, about."""
    return replace(rod, damping=(2 * ratio * 2 * np.pi / slowest_period(rod), 0.0))


def _rods():
    hose, spring = described('rubber_hose'), described('steel_leaf_spring')
    return {'wire': Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34),
            'hose': Rod.tube(outer_diameter=hose.pop('diameter'), **hose),
            'leaf spring': Rod.rectangular(**spring)}


RODS = {name: damped(rod) for name, rod in _rods().items()}
RADII = {'wire': 5e-3, 'hose': 10.5e-3, 'leaf spring': 20e-3}  # m, of the holes
# m; None: a quarter of the room. The hose's room, 2.5 mm, is asked to be half used
TOLERANCES = {'wire': None, 'hose': 1.2e-3, 'leaf spring': 1e-3}


@cache
def cell(name):
    """Return a DirectSimulator and a Plan through a hole, from a start pose of its own."""
    rod, radius = RODS[name], RADII[name]
    direct, length = DirectSimulator(rod), rod.length
    inverse = InverseSimulator(direct)
    hole = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=radius)
    plan = inverse.thread(hole, depths=np.linspace(0, 0.95 * length, 40), max_misalignment=0)
    begin = Pose((-1.3 * length, 0.3 * length, 1 + 0.1 * length), (0, 0, 0, 1))
    return direct, concatenate(inverse.approach(hole, plan, begin, standoff=0.1 * length), plan)


@cache
def tasks(name):
    """Return the LegTasks of the same plan: the way to the hole, and through it."""
    direct, plan = cell(name)
    first = direct.solve(plan.grippers[0], plan.shapes[0])
    return leg_tasks(direct, plan, GripperPath.of(plan), Limits(), first, lambda: None)


@cache
def calm(name):
    """Return the Trajectory of the same plan at default limits."""
    direct, plan = cell(name)
    return Trajectory(plan, tolerance=TOLERANCES[name], simulator=direct)
