# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Ways through a family of shapes: the route over the sphere of equilibria, and the search.

Searches use a quick simulator, whatever the accuracy of the plan: a refusal then costs the same at
any accuracy, and only the plan itself has the accuracy of its simulator.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.continuation import BranchPoint, SolutionBranch
from dlo_planner.inverse.equilibria import Crossings
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.continuity import largest_turn
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Holes

# refusals that tell of the shapes, not of a demand on them
NO_WAY = ('equilibrium', 'stability', 'start', 'continuity', 'direction', 'reach')
_ROUGH = 2e-3       # of the length: accuracy of a search
_CHEAP = 130        # nodes: a simulator with more, or with an accuracy, is too slow for a search
_ELEMENTS = 32      # of a shape on the grid
_GETS_THERE = 0.05  # of a unit vector: the same shape, as far as the grid can tell
_ANY = Pose.looking_along((0, 0, 0), (1, 0, 0))


def quick_simulator(simulator: DirectSimulator) -> DirectSimulator:
    """Return a DirectSimulator of the same DLO that is quick, for searches; itself if it is."""
    around = simulator.surroundings
    quick = simulator.mesh.s.size <= _CHEAP if simulator.accuracy is None else (
        simulator.accuracy >= 0.5 * _ROUGH * around.rod.length)
    if quick:
        return simulator
    return DirectSimulator(around.rod, accuracy=_ROUGH * around.rod.length, gravity=around.gravity,
                           load=around.load, point_loads=around.point_loads)


def grid_nodes(simulator: DirectSimulator) -> Floats:
    """Return nodes (N + 1,) for the grid's shapes, about _ELEMENTS elements."""
    return thinned(simulator.discretization(_ANY, None).s, _ELEMENTS + 1)


def gets_there(simulator: DirectSimulator, gripper: Pose, end: Floats,
               initial: Shape | None = None) -> bool:
    """Whether the DLO itself takes the shape whose free end has the frame `end` (3, 3)."""
    shape = (simulator.solve(gripper) if initial is None
             else simulator.track([gripper], initial=initial)[0])
    return bool(shape.converged and np.abs(shape.frames[-1] - end).max() < _GETS_THERE)


def thinned(depths: Floats, most: int) -> Floats:
    """Return depths (n,), or `most` of them if there are more, spread evenly."""
    if len(depths) <= most:
        return depths
    some: Floats = depths[np.unique(np.linspace(0, len(depths) - 1, most).astype(int))]
    return some


_FARTHEST_TURN, _FARTHEST_SHIFT = 0.6, 0.3  # rad, of the length: what the grid cannot tell
_WEAK, _DEAR = 0.05, 0.1  # stability below which a shape costs more, and how much
_AHEAD = 0.05             # of the length: how far a route is looked along to smooth its rolls


@dataclass(frozen=True, eq=False)
class Route:
    """A route through K curves."""

    depths: Floats  # (K,) depths in m, ascending or descending
    grippers: Floats  # (K, 3, 3) approximate rotations of the gripper
    end: Floats  # (3, 3) approximate rotation of the free end at the beginning
    length: float  # length of the DLO, m
    complete: bool  # whether it goes through all curves that were given
    # part of the length over which rolls are smoothed; 0: every roll is followed as it is
    ahead: float = _AHEAD

    def roll(self, branch: SolutionBranch, point: BranchPoint, depth: float,
             target: float) -> float:
        """Return the roll (rad) to make between two depths, m.

        It leads towards the route a little ahead, so that the grid's roughness averages out.
        """
        shape, ahead = point.shape, self.ahead * self.length
        goal = self._gripper(target + (ahead if target >= depth else -ahead))
        away = Rotation.from_matrix(goal @ shape.gripper.rotation.T).as_rotvec()
        step = abs(target - depth)
        part = 1.0 if ahead + step == 0 else min(1.0, 2 * step / (ahead + step))
        most = 0.5 * largest_turn(step / self.length)
        return float(np.clip(part * (away @ branch.axis(shape)), -most, most))

    def _gripper(self, depth: float) -> Floats:
        if len(self.depths) == 1:
            only: Floats = self.grippers[0]
            return only
        order = slice(None, None, 1 if self.depths[0] <= self.depths[-1] else -1)
        depths, turns = self.depths[order], Rotation.from_matrix(self.grippers[order])
        between: Floats = Slerp(depths, turns)(np.clip(depth, depths[0], depths[-1])).as_matrix()
        return between


def find_route(layers: Sequence[Crossings], depths: Floats, first: Floats,
               length: float) -> Route | None:
    """Return the Route of least motion, as deep as possible, begun at costs (m,), or None."""
    costs, origins = sweep(layers, first, length)
    if not np.isfinite(first).any():
        return None
    picks = picked(origins, int(np.argmin(costs[-1])))
    grippers = np.array([layer.grippers[k] for layer, k in zip(layers, picks, strict=False)])
    return Route(np.asarray(depths[:len(picks)]), grippers, layers[0].ends[picks[0]], length,
                 len(picks) == len(layers))


def sweep(layers: Sequence[Crossings], first: Floats,
          length: float) -> tuple[list[Floats], list[Ints]]:
    """Return costs [(m,)] of the best routes to each crossing, and origins [(m,)] (Bellman 1957).

    The lists end with the last curve that can be reached.
    """
    costs, origins = [first], []
    for one, other in zip(layers, layers[1:], strict=False):
        weak = np.clip(1 - other.stability / _WEAK, 0, 1)
        total = costs[-1][:, None] + motion(one, other, length) + _DEAR * weak**2
        if not len(other) or not np.isfinite(total).any():
            break
        origins.append(np.argmin(total, axis=0))
        costs.append(total.min(axis=0))
    return costs, origins


def picked(origins: list[Ints], last: int) -> list[int]:
    """Return the indices, one per curve, of the best route that ends at crossing `last`."""
    picks = [last]
    for origin in reversed(origins):
        picks.append(int(origin[picks[-1]]))
    return picks[::-1]


def motion(one: Crossings, other: Crossings, length: float) -> Floats:
    """Return the cost (m1, m2) of going from each crossing to each other one."""
    trace = one.grippers.reshape(len(one), 9) @ other.grippers.reshape(len(other), 9).T
    turn = np.arccos(np.clip(0.5 * (trace - 1), -1, 1))
    shift = np.linalg.norm(one.places[:, None] - other.places, axis=2) / length
    far = (turn > _FARTHEST_TURN) | (shift > _FARTHEST_SHIFT)
    return np.where(far, np.inf, turn**2 + shift**2)


def with_certificate(planned: Callable[[], Plan], prove: Callable[[], str]) -> Plan:
    """Return a Plan, or raise Infeasible with a certificate where there is no way for the DLO."""
    try:
        return planned()
    except Infeasible as error:
        if error.constraint in NO_WAY:
            error.prove = prove
        raise


def first_feasible(plans: Iterable[Callable[[], Plan]]) -> Plan:
    """Return the first Plan of some that is one; else the refusal that got farthest is raised."""
    refused: Infeasible | None = None
    for planned in plans:
        try:
            return planned()
        except Infeasible as error:
            if refused is None or error.waypoint > refused.waypoint:
                refused = error
    assert refused is not None  # one is tried at least
    raise refused


@dataclass(frozen=True)
class Threading:
    """What a threading through cut-outs is asked for, on its way through a search."""

    cutouts: tuple[CutOut, ...]
    depths: Floats  # (n,) depths in the first one, m
    start: Pose | None  # whose roll is kept as far as possible
    demands: PlanChecker
    initial: Shape | None = None  # before. If None, the DLO is set down in its natural shape
    method: str = 'coupled'  # or 'nested', for waypoints
    seen: bool = False  # whether the DLO was looked at in `start`

    def at_most(self, most: int) -> 'Threading':
        """Return a quick one: `most` of the depths, unreported; itself if there are no more."""
        if len(self.depths) <= most:
            return self
        return replace(self, depths=thinned(self.depths, most), demands=self.demands.silent(),
                       method='coupled')

    def tried_with(self, quick: DirectSimulator) -> 'Threading':
        """Return an unreported one with a quick simulator, for a search."""
        return replace(self, demands=self.demands.silent().made_with(quick), method='coupled')

    def holes(self, length: float) -> Holes:
        """Return the Holes that a DLO of this length (m) passes."""
        return Holes(self.cutouts, length, self.demands.obstacles, self.demands.surface)


Way = TypeVar('Way')


def plan_branch(task: Threading, planned: Callable[[Threading, Way], Plan], first: Way | None,
                others: Callable[[Infeasible | None], Iterable[Way]], few: int,
                most_demanded: float = np.inf) -> tuple[Plan, Way]:
    """Return the first Plan that one of some ways leads to, and the way.

    All but the first are tried at `few` depths before all of them. If none leads on, the refusal of
    the deepest one is raised, at all depths. After `most_demanded` ways that a demand refuses, no
    other is tried: it refuses all.

    Raises
    ------
    Infeasible, LookupError
        No way leads on; there is none.
    """
    best: tuple[tuple[float, bool], Threading, Way, Infeasible] | None = None
    refused: Infeasible | None = None

    def ways() -> Iterator[Way]:
        if first is not None:
            yield first
        yield from others(refused)

    for number, way in enumerate(ways()):
        task.demands.progress.check()
        if number >= most_demanded and best is not None and best[-1].constraint not in NO_WAY:
            break
        tried = task.at_most(few) if number else task
        try:
            if tried is not task:
                planned(tried, way)
            tried = task
            return planned(task, way), way
        except Infeasible as error:
            refused = refused or error
            depth = tried.depths[error.waypoint], error.constraint == 'start'
            if best is None or depth > best[0]:
                best = depth, tried, way, error
    if best is None:
        raise LookupError
    _, tried, way, deepest = best
    if tried is not task:  # the same at all depths, as evidence
        return planned(task, way), way
    raise deepest
