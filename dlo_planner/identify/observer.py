# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""An estimate of a DLO from looks at it, at rest or moving calmly.

The model: a look shows the equilibrium in the true pose of the gripper, plus a sway of the free end
that is drawn anew for each look, plus noise of each point. The true pose is the measured one, a
constant offset (part of the state), and an error of the robot that wanders. `identify.smoother`
finds the most likely state, and says whether the look agrees with what was expected.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.blas import one_thread
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import InvalidTask
from dlo_planner.identify.estimate import Estimate, RobotError
from dlo_planner.identify.observation import Observation
from dlo_planner.identify.smoother import (
    LagWindow,
    LookErrors,
    LookUpdate,
    estimate_of,
    limit_of,
    window_of,
)
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, instance, integer, number, vector
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Value, put
from dlo_planner.uncertainty.parameters import Uncertainty
from dlo_planner.uncertainty.state import CAMERA, UncertainState, turning

_LONGER = 5.0  # standard deviations of the length by which an arc length may exceed it


class Observer(Value):
    """Turns looks at a DLO into an `Estimate` of it.

    An Observer keeps nothing of the looks; the Estimates do.

    Parameters
    ----------
    simulator : DirectSimulator or Rod
        DirectSimulator of the DLO as stated, or its Rod. The DLO hangs freely from a clamped
        gripper: obstacles are left out, and it does not yield.
    uncertainty : Uncertainty
        Deviations of the DLO and of the gripper's pose from what is stated: the prior.
    noise : float, optional
        Standard deviation of a seen point along each axis, m.
    bias : float, optional
        Standard deviation of the camera's constant error along each world axis, m.
    camera_rotation : float, optional
        Standard deviation of the camera's constant rotation about each world axis, rad.
    stamps : float, optional
        Standard deviation of the constant delay by which the stamps of looks are wrong, s. It is
        identified from looks in motion, see `update`.
    cutout : float, optional
        Standard deviation of the place of each cut-out along each world axis, m. Several are off
        independently; `see_cutout` is of the only one.
    outliers : float, optional
        Part of the points that do not belong to the DLO, 0 to below 1.
    sway : float, optional
        Standard deviation of the free end about its equilibrium along each world axis, m, drawn
        anew for each look; a point at s sways by (s / L)^2 of it. Looks that are spread over a
        period of the swing average it out.
    robot_position, robot_rotation : float, optional
        Standard deviations of the robot's error that is not constant, m along and rad about each
        axis of the gripper: by how much it is elsewhere than it measures, less a constant offset.
    robot_way, robot_time : float, optional
        Way of the gripper, m (a turn counts by a lever of 0.25 m), and time, s, in which that
        error changes, see `identify.estimate.RobotError`. An error that depends on the pose alone
        has an infinite time: it is corrected by what was seen nearby.
    n_terms : int, optional
        Legendre terms along s of each component of the natural curvature.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    _PARTS = ('uncertain', 'noise', 'outliers', 'sway', 'robot')

    uncertain: UncertainState
    noise: float
    outliers: float
    sway: float
    robot: RobotError

    def __init__(self, simulator: DirectSimulator | Rod, uncertainty: Uncertainty, *,
                 noise: float = 0.001, bias: float = 0.0, cutout: float = 0.0,
                 outliers: float = 0.1, sway: float = 0.0, robot_position: float = 0.0,
                 robot_rotation: float = 0.0, robot_way: float = 0.4,
                 robot_time: float = np.inf, n_terms: int = 6, camera_rotation: float = 0.0,
                 stamps: float = 0.0) -> None:
        if isinstance(simulator, Rod):
            simulator = DirectSimulator(simulator)
        simulator = clamping('simulator', simulator)
        if simulator.surroundings.has_moments:
            raise InvalidTask('simulator.point_loads: expected forces alone, dead moments have no '
                              'potential')
        instance('uncertainty', uncertainty, Uncertainty)
        uncertain = UncertainState(simulator.elastic().without_obstacles(), uncertainty,
                              integer('n_terms', n_terms, minimum=1, maximum=20),
                              number('bias', bias, minimum=0), number('cutout', cutout, minimum=0),
                              number('camera_rotation', camera_rotation, minimum=0),
                              number('stamps', stamps, minimum=0))
        if not uncertain.size:
            raise InvalidTask(f'uncertainty = {uncertainty!r}: expected a deviation above 0')
        if not (isinstance(robot_time, float) and robot_time == np.inf):
            robot_time = number('robot_time', robot_time, above=0)
        put(self, uncertain=uncertain, noise=number('noise', noise, above=0),
            outliers=number('outliers', outliers, minimum=0, below=1),
            sway=number('sway', sway, minimum=0),
            robot=RobotError(np.repeat([number('robot_rotation', robot_rotation, minimum=0),
                                        number('robot_position', robot_position, minimum=0)], 3),
                             number('robot_way', robot_way, above=0),
                             robot_time))
        super().__post_init__()

    def begin(self) -> Estimate:
        """Return the prior: the Estimate before any look."""
        return Estimate(self.uncertain, np.zeros(self.uncertain.size),
                        np.diag(self.uncertain.deviations**2), robot=self.robot)

    @one_thread()
    def update(self, estimate: Estimate, observation: Observation, *,
               elapsed: float = 0.0, noise: float | None = None, sway: float | None = None,
               late: ArrayLike = (0.0,) * 6, velocity: ArrayLike = (0.0,) * 6,
               bent: ArrayLike | None = None) -> Estimate:
        """Return the Estimate after one more look.

        If no equilibrium explains the look, the same estimate is returned with `converged` False.
        Whether the look agrees with what was expected before it, `Estimate.agrees` says: one that
        does not should not be believed.

        Parameters
        ----------
        estimate : Estimate
            An Estimate of this observer.
        observation : Observation
            Observation; its gripper is the measured one at the time of the image (`gripper_at`
            finds it in stamped poses). Points in any order; arc lengths, if known, all from the
            same end, whichever it is.
        elapsed : float, optional
            Seconds since the look before, in which the robot's error has wandered.
        noise, sway : float, optional
            Noise and sway in m, for this look alone. If None, the observer's. In motion the sway is
            larger.
        late : array_like, shape (6,), optional
            How the gripper moves in the time by which the stamp of this look alone may be wrong:
            rotation vector, rad, and way, m, world axes. It displaces all points together, each as
            far as the DLO follows its gripper.
        velocity : array_like, shape (6,), optional
            How the gripper moved at the stamp: angular velocity, rad/s, and velocity, m/s, world
            axes. From it the constant delay of the stamps is identified.
        bent : array_like, shape (k, 3), optional
            By how much the DLO is off its rest at k even arc lengths from the gripper to its end,
            m, world axes, as in a motion that was simulated. If None, it is expected at rest.

        Raises
        ------
        InvalidTask
            An argument makes no sense.
        """
        self._own(estimate)
        elapsed = number('elapsed', elapsed, minimum=0)
        if instance('observation', observation, Observation).far_end is not None:
            raise InvalidTask('observation.far_end: expected None, the DLO hangs freely')
        if observation.normal is not None:
            raise InvalidTask('observation.normal: expected None, `fit_rod` alone takes pictures')
        length = self.uncertain.simulator.rod.length + _LONGER * self.uncertain.uncertainty.length
        if observation.s is not None and ((observation.s < 0) | (observation.s > length)).any():
            raise InvalidTask(f'observation.s: expected 0 to the length {length:g} m')
        noise = self.noise if noise is None else number('noise', noise, above=0)
        sway = self.sway if sway is None else number('sway', sway, minimum=0)
        errors = LookErrors(sway, tuple(vector('late', late, 6).tolist()),
                            tuple(vector('velocity', velocity, 6).tolist()))
        if bent is not None:
            bent = array('bent', bent, (None, 3))
        after = LookUpdate(estimate, observation, self.outliers, elapsed, noise, errors,
                           bent).estimate()
        return replace(estimate, converged=False) if after is None else after

    @one_thread()
    def see_cutout(self, estimate: Estimate, stated: ArrayLike, seen: ArrayLike,
                   noise: float | None = None) -> Estimate:
        """Return the Estimate after the center of the cut-out has been seen by the same camera.

        The camera displaces DLO and cut-out alike: its error there cancels in the predicted miss.

        Parameters
        ----------
        estimate : Estimate
            An Estimate of this observer.
        stated : array_like, shape (3,)
            Center of the cut-out as stated, m, world axes.
        seen : array_like, shape (3,)
            As seen.
        noise : float, optional
            Standard deviation of `seen` along each axis, m. If None, the observer's noise.

        Raises
        ------
        InvalidTask
            An argument makes no sense, or the cut-out's place is not uncertain.
        """
        self._own(estimate)
        stated = vector('stated', stated, 3)
        off = vector('seen', seen, 3) - stated
        noise = self.noise if noise is None else number('noise', noise, above=0)
        if not self.uncertain.cutout:
            raise InvalidTask('cutout = 0: expected an observer that takes the cut-out\'s place as '
                              'uncertain')
        window = window_of(estimate).about(stated)
        rows = self._cutout_rows(window, stated)
        window = window.with_linear(rows * self.uncertain.deviations / noise, off / noise)
        return estimate_of(estimate, window)

    @one_thread()
    def reopened(self, estimate: Estimate, position: float, rotation: float, *,
                 kink: float = 0.0, camera: float = 0.0, cutout: float = 0.0) -> Estimate:
        """Return the Estimate in which the DLO may have slipped in the gripper, or been bent.

        The gripper's offset becomes as uncertain as stated here, beyond the prior, and what earlier
        looks tell of it is forgotten. What else is known of the DLO stays, but for a kink, which
        the natural curvature may have got anywhere. How well looks agreed is not forgotten:
        `Estimate.inflation` stays.

        Parameters
        ----------
        estimate : Estimate
            An Estimate of this observer.
        position, rotation : float
            Standard deviations of the slip, m along and rad about each axis of the gripper.
        kink : float, optional
            Standard deviation of the angle of a kink about each of the two axes of the section,
            rad, at a place that is not known: what a bump leaves of a wire that yields.
        camera : float, optional
            Standard deviations of the camera's error and of the delay of its stamps, as multiples
            of the prior; what earlier looks tell of them is forgotten. If 0, it stays known.
        cutout : float, optional
            Standard deviation of how far the cut-out may have moved along each axis, m.

        Raises
        ------
        InvalidTask
            An argument makes no sense.
        """
        self._own(estimate)
        position = number('position', position, minimum=0)
        rotation = number('rotation', rotation, minimum=0)
        kink = number('kink', kink, minimum=0)
        camera = number('camera', camera, minimum=0)
        cutout = number('cutout', cutout, minimum=0)
        covariance, mean = np.array(estimate.covariance), np.array(estimate.mean)
        unit, length = self.uncertain.deviations, self.uncertain.simulator.rod.length
        forgotten = [('gripper_position', 1.0, position), ('gripper_rotation', 1.0, rotation)]
        if camera:
            forgotten += [(name, camera, 0.0) for name in CAMERA]
        for name, times, more in forgotten:
            columns, _ = self.uncertain.columns(name)
            covariance[columns] = 0.0
            covariance[:, columns] = 0.0
            covariance[columns, columns] = (times * unit[columns])**2 + more**2
            if times != 1.0:  # a mean that was found by what is not believed any more
                mean[columns] = 0.0
        # A kink at an unknown place is white noise of the curvature: a delta function there has the
        # coefficients angle (2 j + 1) / L P_j, whose mean squares along the DLO are angle^2
        # (2 j + 1) / L^2, and which are independent
        bent, numbers = self.uncertain.columns('natural_curvature')
        covariance[bent, bent] += (2 * (numbers // 2) + 1) * (kink / length)**2
        moved, _ = self.uncertain.columns('cutout')
        covariance[moved, moved] += cutout**2
        old = window_of(estimate)
        window = replace(LagWindow.of(mean / unit, covariance / np.outer(unit, unit),
                                      self.robot.acting.size),
                         consistency=old.consistency, reference=old.reference,
                         camera_scale=camera or old.camera_scale)
        return replace(estimate, mean=mean, covariance=covariance, _memory=window)

    def cutout_innovation(self, estimate: Estimate, stated: ArrayLike, seen: ArrayLike,
                        noise: float | None = None) -> float:
        """Return how far off a cut-out is seen: a chi-square by what chance hardly exceeds.

        Parameters
        ----------
        estimate : Estimate
            An Estimate of this observer.
        stated, seen : array_like, shape (3,)
            Center of the cut-out as stated and as seen, m, world axes.
        noise : float, optional
            Standard deviation of `seen` along each axis, m. If None, the observer's noise.

        Raises
        ------
        InvalidTask
            An argument makes no sense.
        """
        self._own(estimate)
        stated = vector('stated', stated, 3)
        noise = self.noise if noise is None else number('noise', noise, above=0)
        window = window_of(estimate).about(stated)
        rows = self._cutout_rows(window, stated) * self.uncertain.deviations
        n = rows.shape[1]
        off = vector('seen', seen, 3) - stated - rows @ window.mean[:n]
        spread = rows @ window.covariance[:n, :n] @ rows.T + noise**2 * np.eye(3)
        return float(off @ np.linalg.solve(spread, off)) / limit_of(off.size)

    def _cutout_rows(self, window: LagWindow, stated: Floats) -> Floats:
        """Return (3, n) the derivatives of where a cut-out is seen, stated at a place (3,)."""
        rows = np.zeros((3, self.uncertain.size))
        for name in ('camera', 'cutout'):
            columns, numbers = self.uncertain.columns(name)
            rows[numbers, columns] = 1.0
        assert window.reference is not None  # the window was asked for one
        turned, about = self.uncertain.columns('camera_rotation')
        rows[:, turned] = turning(stated[None] - window.reference)[0][:, about]
        return rows

    def _own(self, estimate: Estimate) -> None:
        if instance('estimate', estimate, Estimate).uncertain != self.uncertain:
            raise InvalidTask('estimate: expected one of this observer')
