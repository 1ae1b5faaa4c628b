# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The report of a replay: the worst values of a plan, at rest and in motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from os import PathLike
from typing import Any

import numpy as np

from dlo_planner.direct.storage import load, save
from dlo_planner.model.checks import figure, flag, instance, items
from dlo_planner.model.value import brief, put
from dlo_planner.pictured import Reported
from dlo_planner.trajectory.trajectory import Trajectory, trajectory_of, trajectory_tree

_OTHERS = ('trajectory', 'not_looked_at')  # fields that are no numbers or texts


def report_tree(report: ValidationReport) -> dict[str, Any]:
    """Return a tree (see `direct.storage`) of all of a ValidationReport."""
    tree = {item.name: getattr(report, item.name) for item in fields(report)
            if item.name not in _OTHERS}
    tree['not_looked_at'] = np.array(report.not_looked_at, dtype=str)
    return tree if report.trajectory is None else {
        **tree, 'trajectory': trajectory_tree(report.trajectory)}


def report_of(tree: Mapping[str, Any]) -> ValidationReport:
    """Return the ValidationReport of the tree of `report_tree`."""
    contents = {name: content.item() for name, content in tree.items() if name not in _OTHERS}
    return ValidationReport(
        **contents, not_looked_at=tuple(tree['not_looked_at'].tolist()),
        trajectory=trajectory_of(tree['trajectory']) if 'trajectory' in tree else None)


@dataclass(frozen=True, eq=False, repr=False)
class ValidationReport(Reported):
    """Result of a direct simulation of a plan: worst values over all waypoints, or in motion.

    A figure that was not computed is nan, and `not_looked_at` names it.

    The figures of a motion that could not be simulated to its end are infinitely bad.

    Attributes
    ----------
    converged : bool
        Every pose has an equilibrium that continues the one before, and it is the one of the plan:
        its `deviation` is below 1 % of the length.
    position_error : float
        Distance of the DLO from a center that it should pass, m.
    misalignment : float
        Angle between the DLO and a direction in which it should pass, rad: of an oblique plan the
        planned one, while `Plan.misalignment` is against the normal.
    residual : float
        Largest residual of the shapes.
    stability : float
        Least stability of the shapes.
    bend_margin : float
        Least bend margin of the shapes at rest, 1/m; nan of a rod without max_bend_curvature.
    contact_force : float
        Largest force of one contact with the simulator's obstacles, N; nan where a bore takes the
        DLO: its `insertion_force` is estimated, that of each contact there is not looked at.
    clearance : float
        Clearance in m to the sized cut-outs of the plan and the obstacles given.
    deviation : float
        Largest distance between the shapes found and those of the plan, m.
    max_tracking_error : float
        `InMotion.position_error`, m; here and below the worse of two motions: with the rod's
        damping, and without any.
    dynamic_clearance : float
        `InMotion.clearance`, m.
    dynamic_contact_force : float
        `InMotion.contact_force`, N.
    dynamic_bend_margin : float
        `InMotion.bend_margin`, 1/m.
    contact_lost : float
        `InMotion.contact_lost`, or the part of the waypoints at rest, whichever is larger; nan
        where none is lost without friction, and no friction is stated (see `replay`).
    insertion_force : float
        Largest `Plan.insertion_force` in N that is known, an estimate; nan where none is, or there
        is no bore. Where only some are, `not_looked_at` says how many are not, and why.
    largest_friction : float
        Friction of the obstacles up to which, from none, the report holds; nan: it holds for that
        of the simulator's obstacles alone.
    swing : float
        `InMotion.swing`, m.
    arrival : float
        `InMotion.arrival`, m.
    departure : float
        `InMotion.departure`, m.
    duration : float
        `InMotion.duration`, s.
    step : float
        `InMotion.step`, s.
    workspace_margin : float
        Least distance of the gripper from the limits of its workspace, m.
    mode_margin : float
        See `Trajectory`.
    tolerance : float
        Tolerance in m, of `trajectory`.
    trajectory : Trajectory or None
        Trajectory that was validated, the one to be executed. If None, there was none.
    reason : str
        Why the trajectory must not be executed; empty if it may be.
    not_looked_at : tuple of str
        Names of the figures that are nan; of `insertion_force` also at how many waypoints it is
        not known, by their `Plan.insertion_status`: 'insertion_force: jams at 2 of 13 waypoints'.
    """

    converged: bool
    position_error: float
    misalignment: float
    residual: float
    stability: float
    bend_margin: float
    contact_force: float
    clearance: float
    deviation: float = np.nan
    max_tracking_error: float = np.nan
    swing: float = np.nan
    arrival: float = np.nan
    departure: float = np.nan
    dynamic_clearance: float = np.nan
    dynamic_contact_force: float = np.nan
    dynamic_bend_margin: float = np.nan
    contact_lost: float = np.nan
    insertion_force: float = np.nan
    largest_friction: float = np.nan
    duration: float = np.nan
    step: float = np.nan
    workspace_margin: float = np.nan
    mode_margin: float = np.nan
    tolerance: float = np.nan
    trajectory: Trajectory | None = None
    reason: str = 'it was not looked at in motion'
    not_looked_at: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        put(self, converged=flag('ValidationReport.converged', self.converged),
            **{item.name: figure(f'ValidationReport.{item.name}', getattr(self, item.name))
               for item in fields(self) if item.type == 'float'},
            trajectory=instance('ValidationReport.trajectory', self.trajectory, Trajectory,
                                optional=True),
            reason=instance('ValidationReport.reason', self.reason, str),
            not_looked_at=items('ValidationReport.not_looked_at', self.not_looked_at, str))

    def __repr__(self) -> str:
        units = {'position_error': 'm', 'stability': '', 'clearance': 'm', 'deviation': 'm',
                 'max_tracking_error': 'm', 'swing': 'm', 'dynamic_clearance': 'm', 'duration': 's'}
        return brief(self, 'safe' if self.safe else f'not safe: {self.reason}', *(
            f'{name.replace("_", " ")} {getattr(self, name):.3g} {unit}'.rstrip()
            for name, unit in units.items() if np.isfinite(getattr(self, name))))

    def save(self, path: str | PathLike[str]) -> None:
        """Write the report and its trajectory, as npz or JSON (see `Plan.save`)."""
        save(path, report_tree(self), 'ValidationReport')

    @classmethod
    def load(cls, path: str | PathLike[str]) -> ValidationReport:
        """Return the ValidationReport saved at `path`.

        Raises
        ------
        InvalidTask
            Not such a file; the message names it.
        """
        return load(path, report_of, 'ValidationReport')

    @property
    def safe(self) -> bool:
        """Whether `trajectory` may be executed: the DLO follows it calmly and touches nothing."""
        return not self.reason
