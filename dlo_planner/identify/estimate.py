# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is known of a DLO and of its gripper after some looks: a mean and a covariance."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.deprecated import renamed
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.identify.predicted_miss import (
    PredictedMiss,
    judged_plan,
    judged_waypoints,
    miss_of,
)
from dlo_planner.identify.settling import settled
from dlo_planner.identify.uncertain import Uncertain
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import flag, instance, integer, vector
from dlo_planner.model.computed import figure, results
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import FrozenDict, Value, brief, put
from dlo_planner.plan.plan import Plan


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Value):
    """A normal distribution of the n numbers that are uncertain; an `Observer` makes it.

    Attributes
    ----------
    uncertain : Uncertain
        The meaning of the numbers, see `identify.uncertain`.
    mean : ndarray, shape (n,)
        Logarithms of factors, 1/m, rad, m, as in `names`.
    covariance : ndarray, shape (n, n)
        Covariance of the same numbers.
    looks : int
        Number of observations that it rests on.
    converged : bool
        Whether the last observation could be used; if not, this is the one before it.
    misfit : float
        Root mean square distance of the points of the last look from the DLO, m, each weighed by
        the probability that it belongs to the DLO; nan before the first look. Looks at one pose
        without sway are taken together.
    outliers : float
        Part of the same points that seem not to belong to the DLO; nan before the first.
    """

    uncertain: Uncertain
    mean: Floats
    covariance: Floats
    looks: int = 0
    converged: bool = True
    misfit: float = np.nan
    outliers: float = np.nan
    _shape: Shape | None = field(default=None, compare=False)
    _memory: Any = field(default=None, compare=False)  # of the looks, see `identify.memory`

    def __post_init__(self) -> None:
        n = instance('Estimate.uncertain', self.uncertain, Uncertain).size
        put(self, mean=results('Estimate.mean', self.mean, (n,)),
            covariance=results('Estimate.covariance', self.covariance, (n, n)),
            looks=integer('Estimate.looks', self.looks, minimum=0, maximum=10**12),
            converged=flag('Estimate.converged', self.converged),
            misfit=figure('Estimate.misfit', self.misfit),
            outliers=figure('Estimate.outliers', self.outliers))
        if not (np.isfinite(self.mean).all() and np.isfinite(self.covariance).all()):
            raise InvalidTask('Estimate.mean, Estimate.covariance: expected finite numbers')
        instance('Estimate._shape', self._shape, Shape, optional=True)
        super().__post_init__()

    def __repr__(self) -> str:
        return brief(self, f'{self.looks} looks',
                     '' if self.converged else 'last one not converged',
                     f'misfit {self.misfit:.2g} m' if self.looks else '',
                     f'{self.uncertain.size} numbers')

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n numbers."""
        return self.uncertain.names

    @property
    def values(self) -> FrozenDict:
        """Dict of the n numbers by name, in logarithms of factors, 1/m, rad, m."""
        return FrozenDict(zip(self.names, self.mean.tolist(), strict=True))

    @property
    def deviations(self) -> FrozenDict:
        """Dict of their standard deviations."""
        return FrozenDict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def rod(self) -> Rod:
        """Estimated Rod. Its ratio of stiffness to weight is known; each by itself is not."""
        return self.uncertain.rod(self.mean)

    @property
    def simulator(self) -> DirectSimulator:
        """DirectSimulator of the estimated Rod, without obstacles, for a new plan."""
        return self.uncertain.simulator.with_rod(self.rod)

    @property
    def gripper_offset(self) -> Pose:
        """Estimated true Pose of the gripper in the frame of the commanded one."""
        return self.uncertain.offset(self.mean)

    @property
    def camera_bias(self) -> Floats:
        """Estimated bias (3,) of the camera, seen minus true, m, world axes."""
        return self.uncertain.camera(self.mean)

    def actual(self, gripper: Pose) -> Pose:
        """Return the estimated true Pose of the gripper that is commanded to `gripper`."""
        result: Pose = instance('gripper', gripper, Pose).compose(self.gripper_offset)
        return result

    def commanded(self, gripper: Pose) -> Pose:
        """Return the Pose to command so that the true pose of the gripper is `gripper`."""
        result: Pose = instance('gripper', gripper, Pose).compose(self.gripper_offset.inverse())
        return result

    centre = renamed('centre', 'center')

    def center(self, center: ArrayLike) -> Floats:
        """Return the estimated true center (3,) of a cut-out that is stated at `center` (3,), m."""
        return vector('center', center, 3) + self.uncertain.shifted(self.mean)

    def moved_cutout(self, cutout: CutOut) -> CutOut:
        """Return a stated CutOut, moved to its estimated true place."""
        pose = instance('cutout', cutout, CutOut).pose
        return CutOut(Pose.from_rotation(self.center(pose.position), pose.rotation),
                      cutout.radius, cutout.width, cutout.height)

    def shape(self, gripper: Pose) -> Shape:
        """Return the estimated Shape of the DLO with the gripper commanded to `gripper`.

        The DLO hangs freely. It comes from its shape at the last look; before the first look it is
        set down in its natural shape.
        """
        actual = self.actual(gripper)
        mesh = self.uncertain.simulator.discretization(actual, None)
        return settled(self.uncertain.varied(mesh), self.mean, actual, self._shape)

    def miss(self, plan: Plan, waypoints: ArrayLike | None = None) -> PredictedMiss:
        """Return the PredictedMiss of the DLO at waypoints of a commanded plan.

        Parameters
        ----------
        plan : Plan
            Plan whose poses are commanded, and whose centers are as stated.
        waypoints : array_like, shape (k,), optional
            Indices of waypoints that pass a center. If None, all that do.

        Raises
        ------
        InvalidTask
            An argument makes no sense.
        """
        return miss_of(self, judged_plan(self, plan), judged_waypoints(plan, waypoints))
