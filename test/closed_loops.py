# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threadings of DLOs that are not as stated, with the direct simulator as the truth.

`python test/closed_loops.py [seeds]` prints how far off the entry is in open and in closed loop,
and whether the estimates are as good as they say. What is true has more in it than what is
estimated: natural curvature by twelve Legendre polynomials, where the observer has six.
"""

import sys
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.spatial.transform import Rotation

sys.path[:0] = [str(Path(__file__).parent.parent)]

from dlo_planner import (  # noqa: E402
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Observer,
    Pose,
    Rod,
    Uncertainty,
)
from dlo_planner.identify import Observation, correct  # noqa: E402
from dlo_planner.model.varying import Expanded  # noqa: E402
from dlo_planner.penalties import Through  # noqa: E402
from dlo_planner.uncertainty.parameters import variation_deviations  # noqa: E402

SPREAD = Uncertainty(bending_stiffness=0.05, torsional_stiffness=0.05, mass=0.02, length=1e-3,
                natural_curvature=0.05, curvature_variation=0.03, gripper_position=0.5e-3,
                gripper_rotation=np.radians(0.2))
WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
HOLE = CutOut(Pose.looking_along((0.4, 0, 1), (1, 0.2, 0)), radius=5e-3)
DEPTHS = np.linspace(0, 0.3, 13)
NOISE = 1e-3
_TERMS = 12


@dataclass
class Truth:
    """A DLO, a gripper and a camera as they are."""

    simulator: DirectSimulator
    offset: Pose
    bias: np.ndarray
    hole: np.ndarray

    @classmethod
    def drawn(cls, rng, rod=WIRE, spread=SPREAD, bias=0.0, cutout=0.0):
        """Return one of those that an Uncertainty stands for."""
        bend, twist, mass = np.exp(rng.normal(size=3) * (
            spread.bending_stiffness, spread.torsional_stiffness, spread.mass))
        length = rod.length + spread.length * rng.normal()
        terms = np.append(spread.natural_curvature,
                          spread.curvature_variation * variation_deviations(_TERMS - 1))
        natural = Expanded(rod.natural_curvature, terms[:, None] * rng.normal(size=(_TERMS, 2)),
                           length)
        true = replace(rod, length=length, mass_per_length=mass * rod.mass_per_length, section=None,
                       section_model='ideal',
                       bending_stiffness=tuple(bend * np.array(rod.bending_stiffness)),
                       torsional_stiffness=twist * rod.torsional_stiffness,
                       natural_curvature=natural)
        offset = Pose(spread.gripper_position * rng.normal(size=3), Rotation.from_rotvec(
            spread.gripper_rotation * rng.normal(size=3)).as_quat())
        return cls(DirectSimulator(true), offset, bias * rng.normal(size=3),
                   cutout * rng.normal(size=3))

    def shape(self, gripper):
        """Return the Shape where the gripper is said to be at a Pose."""
        return self.simulator.solve(gripper.compose(self.offset))

    def seen(self, rng, gripper, count=24, hidden=1 / 3, outliers=0.1, known=False, shape=None,
             begin=None):
        """Return an Observation: noise, outliers, a part of the DLO hidden, in any order."""
        shape = self.shape(gripper) if shape is None else shape
        if begin is None:  # of what is hidden
            begin = rng.uniform(0.05, 0.95 - hidden)
        s = rng.uniform(0, 1 - hidden, size=count)
        s = np.where(s > begin, s + hidden, s) * shape.s[-1]
        points = shape.positions_at(s) + NOISE * rng.normal(size=(count, 3)) + self.bias
        wild = rng.uniform(size=count) < outliers
        points[wild] += rng.uniform(-0.15, 0.15, size=(wild.sum(), 3))
        return Observation(gripper, points, s if known else None)

    def miss(self, plan_pass, gripper):
        """Return (3,) from the hole to where the DLO passes."""
        return Through(plan_pass[0] + self.hole).residuals(self.shape(gripper))


class Touching:
    """A Truth whose DLO may touch obstacles: each Shape follows the last one."""

    def __init__(self, truth, *obstacles):
        self._offset, self._last = truth.offset, None
        self._simulator = DirectSimulator(truth.simulator.rod, obstacles=obstacles)

    def shape(self, gripper):
        """Return the Shape where the gripper is said to be at a Pose."""
        self._last = self._simulator.track([gripper.compose(self._offset)], initial=self._last)[0]
        return self._last


def looked(truth, observer, rng, gripper, looks=30, estimate=None, **how):
    """Return the Estimate after some looks at rest; the same third of the DLO is hidden in all."""
    estimate = observer.begin() if estimate is None else estimate
    how = {'shape': truth.shape(gripper), 'begin': rng.uniform(0.05, 0.6), **how}
    for _ in range(looks):
        estimate = observer.update(estimate, truth.seen(rng, gripper, **how))
    return estimate


def plan_of(rod=WIRE, hole=HOLE, start=None, depths=DEPTHS):
    return _planned(rod, hole, start, tuple(depths))


@cache
def _planned(rod, hole, start, depths):
    return InverseSimulator(DirectSimulator(rod)).thread(hole, depths=depths, start=start)


START = Pose.looking_along((-0.6, 0, 1.1), (1, 0, 0.2))


def surprise(off, estimate):
    """Return the squared error of a miss in units of its covariance: a chi-square of 2 on average.

    Args:
        off: (3,) the true miss; estimate: PredictedMiss, its first waypoint
    """
    across = np.linalg.svd(HOLE.normal[None])[2][1:]
    error = across @ (off - estimate.off[0])
    return float(error @ np.linalg.solve(across @ estimate.covariance[0] @ across.T, error))


def threaded(seed, plan, observer, looks=30, again=15, **errors):
    """Return the true misses at the entry, m, and the surprises: open, one look, a second one.

    The second look is from the standoff, 0.1 m before the entry.
    """
    rng = np.random.default_rng(seed)
    truth = Truth.drawn(rng, **errors)
    passing, gripper = plan.via_points[0][0], plan.grippers[0]
    misses, surprises, bounds = [truth.miss(passing, gripper)], [], []
    estimate = None
    for count in (looks, again):
        at = START if estimate is None else Pose(
            gripper.position - 0.1 * HOLE.normal, gripper.quaternion)
        estimate = looked(truth, observer, rng, at, count, estimate)
        if observer.uncertain.cutout:
            seen = HOLE.center + truth.hole + truth.bias + NOISE / 4 * rng.normal(size=3)
            estimate = observer.see_cutout(estimate, HOLE.center, seen, NOISE / 4)
        correction = correct(estimate, plan)
        gripper = correction.grippers[0]
        misses.append(truth.miss(passing, gripper))
        surprises.append(surprise(misses[-1], correction.miss))
        bounds.append(correction.miss.bound[0])
    return np.linalg.norm(misses, axis=1), np.array(surprises), np.array(bounds)


def best(function, times=10):
    """Return the least time of some calls, ms."""
    taken = []
    for _ in range(times):
        begin = perf_counter()
        function()
        taken.append(perf_counter() - begin)
    return 1e3 * min(taken)


def print_times(plan):
    rng = np.random.default_rng(0)
    truth, observer = Truth.drawn(rng), Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE)
    look = truth.seen(rng, START)
    for looks in (1, 31):
        estimate = looked(truth, observer, rng, START, looks - 1 or 1)
        print(f'look {looks}: {best(lambda known=estimate: observer.update(known, look)):.1f} ms')
    correction = correct(estimate, plan)
    print(f'correction of {len(plan)} waypoints: {best(lambda: correct(estimate, plan)):.1f} ms, '
          f'warm {best(lambda: correct(estimate, plan, 0, correction)):.1f} ms')


def main(seeds):
    print_times(plan_of(depths=np.linspace(0, 0.3, 30)))
    plan = plan_of()
    for name, errors in (('DLO and gripper', {}),
                         ('and camera, hole 0.5 mm each', {'bias': 0.5e-3, 'cutout': 0.5e-3})):
        observer = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE, **errors)
        misses, surprises, bounds = (np.array(part) for part in zip(*(
            threaded(seed, plan, observer, **errors) for seed in range(seeds)), strict=True))
        print(f'{name}, {seeds} seeds; median, 95 %, largest miss at the entry in mm')
        for k, when in enumerate(('open loop', 'one look', 'and one at the standoff')):
            print(f'  {when:24}', *(f'{1e3 * np.quantile(misses[:, k], q):8.2f}'
                                    for q in (0.5, 0.95, 1.0)),
                  *((f'  chi-square {surprises[:, k - 1].mean():.2f} of 2',
                     f'within the bound {np.mean(misses[:, k] <= bounds[:, k - 1]):.0%}')
                    if k else ()))


if __name__ == '__main__':
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
