"""Motions that the tests of calm trajectories share: a start pose of its own, then through the hole."""

from functools import cache
from pathlib import Path

import numpy as np
import yaml

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose, Rod, Trajectory
from dlo_planner.inverse.calm import LegTask
from dlo_planner.inverse.leg_response import Response
from dlo_planner.inverse.limits import Limits
from dlo_planner.inverse.passing import holes_passed
from dlo_planner.inverse.path import GripperPath
from dlo_planner.inverse.plan import joined
from dlo_planner.inverse.trajectory import _quick

CONFIG = Path(__file__).parent.parent / 'config'
RADII = {'copper_wire': 5e-3, 'rubber_hose': 10.5e-3, 'steel_leaf_spring': 20e-3}  # m, of the holes


@cache
def rod_of(name, damping):
    """Return the Rod of a file in config/, with a damping ratio of all its modes, about."""
    file = yaml.safe_load((CONFIG / f'{name}.yaml').read_text())
    told = dict(file['dlo_planner']['ros__parameters']['rod'])
    kind, _ = told.pop('section'), told.pop('name')
    outer, inner, made = (told.pop(key, None) for key in ('diameter', 'inner_diameter', 'damping'))
    rod = {'circular': lambda: Rod.circular(diameter=outer, **told),
           'tube': lambda: Rod.tube(outer_diameter=outer, inner_diameter=inner, **told),
           'rectangular': lambda: Rod.rectangular(**told)}[kind]()
    del made
    if not damping:
        return rod.replace(damping=0.0) if hasattr(rod, 'replace') else rod
    return rod


@cache
def cell(rod, radius, start=True):
    """Return a DirectSimulator and a Plan through a hole, from a start pose of its own."""
    direct, length = DirectSimulator(rod), rod.length
    inverse = InverseSimulator(direct)
    hole = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=radius)
    plan = inverse.thread(hole, depths=np.linspace(0, 0.95 * length, 40))
    if not start:
        return direct, plan
    begin = Pose((-1.3 * length, 0.3 * length, 1 + 0.1 * length), (0, 0, 0, 1))
    return direct, joined(inverse.start_phase(hole, plan, begin, standoff=0.1 * length), plan)


@cache
def tasks(rod, radius):
    """Return the LegTasks of the same plan: the way to the hole, and through it."""
    direct, plan = cell(rod, radius)
    quick, made = _quick(direct), []
    shape = quick.solve(plan.grippers[0], plan.shapes[0])
    legs = GripperPath.of(plan).legs
    for leg in legs:
        response = Response.of(quick, leg, shape)
        shape = response.shapes[-1]
        made.append(LegTask(leg, response, Limits(), holes_passed(plan, response.parameters),
                            leg is legs[-1]))
    return made


@cache
def calm(rod, radius):
    """Return the Trajectory of the same plan at default limits and tolerance."""
    direct, plan = cell(rod, radius)
    return Trajectory(plan, simulator=direct)
