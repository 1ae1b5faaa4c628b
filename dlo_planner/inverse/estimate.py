"""What is believed of a DLO and of its gripper after some looks."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.plan import Plan
from dlo_planner.inverse.predicted_miss import PredictedMiss, judged_waypoints, miss_of
from dlo_planner.inverse.settling import settled
from dlo_planner.inverse.uncertain import Uncertain
from dlo_planner.model.checks import figure, flag, instance, integer, results, vector
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import FrozenDict, Value, brief, put


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Value):
    """A normal distribution of what is uncertain, n numbers; an `Observer` makes it.

    Attributes:
        uncertain: what the numbers are, see `inverse.uncertain`
        mean: (n,); covariance: (n, n); in the units that `names` have in `Spread`
        looks: how many observations have been taken in
        converged: whether the last one was; if not, this is the estimate of before
        misfit: root mean square distance of the points of the last look from the DLO, outliers
            left out, m; nan before the first
        outliers: part of the points of the last look that are taken to be none of the DLO; nan
            before the first
    """

    uncertain: Uncertain
    mean: np.ndarray
    covariance: np.ndarray
    looks: int = 0
    converged: bool = True
    misfit: float = np.nan
    outliers: float = np.nan
    _shape: Shape | None = field(default=None, compare=False)
    _memory: object = field(default=None, compare=False)  # of the looks, see `inverse.smoothing`

    def __post_init__(self):
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

    def __repr__(self):
        return brief(self, f'{self.looks} looks',
                     '' if self.converged else 'last one not converged',
                     f'misfit {self.misfit:.2g} m' if self.looks else '',
                     f'{self.uncertain.size} numbers')

    @property
    def names(self) -> tuple[str, ...]:
        """What the n numbers are."""
        return self.uncertain.names

    @property
    def values(self) -> FrozenDict:
        """Dict of the n numbers by name: logarithms of factors, 1/m, rad, m."""
        return FrozenDict(zip(self.names, self.mean.tolist(), strict=True))

    @property
    def deviations(self) -> FrozenDict:
        """Dict of their standard deviations."""
        return FrozenDict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def rod(self) -> Rod:
        """The Rod as estimated. Stiffness and weight are right as a ratio, not each by itself."""
        return self.uncertain.rod(self.mean)

    @property
    def simulator(self) -> DirectSimulator:
        """The DirectSimulator of the DLO as estimated, without obstacles: to plan anew with."""
        return self.uncertain.simulator.with_rod(self.rod)

    @property
    def gripper_offset(self) -> Pose:
        """The gripper as it is, in the frame of the gripper as it is said to be."""
        return self.uncertain.offset(self.mean)

    @property
    def camera_bias(self) -> np.ndarray:
        """(3,) by which the camera sees all points displaced, m, world axes."""
        return self.uncertain.camera(self.mean)

    def actual(self, gripper: Pose) -> Pose:
        """Return the Pose where the gripper is that is said to be at `gripper`."""
        return instance('gripper', gripper, Pose).compose(self.gripper_offset)

    def commanded(self, gripper: Pose) -> Pose:
        """Return the Pose to command so that the gripper comes to be at `gripper`."""
        return instance('gripper', gripper, Pose).compose(self.gripper_offset.inverse())

    def centre(self, centre: ArrayLike) -> np.ndarray:
        """Return where the centre (3,) of a cut-out is that is stated at `centre` (3,), m."""
        return vector('centre', centre, 3) + self.uncertain.shifted(self.mean)

    def moved_cutout(self, cutout: CutOut) -> CutOut:
        """Return a CutOut where it is estimated to be; `cutout` is where it is stated."""
        pose = instance('cutout', cutout, CutOut).pose
        return CutOut(Pose.from_rotation(self.centre(pose.position), pose.rotation),
                      cutout.radius, cutout.width, cutout.height)

    def shape(self, gripper: Pose) -> Shape:
        """Return the Shape that the DLO is estimated to take, the gripper said to be at `gripper`.

        It hangs freely, and comes from the shape of the last look, or is set down there.
        """
        actual = self.actual(gripper)
        mesh = self.uncertain.simulator.discretisation(actual, None)
        return settled(self.uncertain.varied(mesh), self.mean, actual, self._shape)

    def miss(self, plan: Plan, waypoints: ArrayLike | None = None) -> PredictedMiss:
        """Return by how much the DLO will miss at waypoints of a plan, as it is commanded.

        Args:
            plan: Plan, in poses that are commanded; the centres that it passes are as stated
            waypoints: indices of waypoints that pass a centre; None: all that do

        Raises:
            InvalidTask: an argument makes no sense
        """
        return miss_of(self, self._judged(plan), judged_waypoints(plan, waypoints))

    def _judged(self, plan):
        instance('plan', plan, Plan)
        length = self.uncertain.simulator.rod.length
        for shape in plan.shapes:
            if shape._discretisation is None or abs(shape.s[-1] / length - 1) > 0.1:
                raise InvalidTask('plan: expected shapes of the whole DLO that is estimated')
        return plan
