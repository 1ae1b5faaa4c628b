# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The proof of a plan, step by step: slowly, which is known quickly, then as it is executed."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import DeadlineExceeded, DloPlannerError
from dlo_planner.execute.causes import Cause
from dlo_planner.plan.plan import Plan
from dlo_planner.ros.scene import Scene
from dlo_planner.ros.worker import ATTEMPTS, ProcessLost, persistent
from dlo_planner.verify.report import ValidationReport

DONE = ('held', 'refused')  # states of a proof that has no step left
_CHECKED = 'the plan is still being checked: ask again'
_MOVED = 'the motion along the plan is still being made and checked: ask again'


@dataclass(frozen=True)
class Proof:
    """How far the proof of a plan has come, and what it says.

    Attributes
    ----------
    plan : Plan
    report : ValidationReport or None
        ValidationReport, of the last step that was done, or None.
    reason : str
        Why its trajectory must not be executed; empty: it may be.
    done : bool
        Whether no step is left.
    cause : Cause
        Number of the reason.
    """

    plan: Plan
    report: ValidationReport | None = None
    reason: str = _CHECKED
    done: bool = False
    cause: Cause = Cause.PROOF_PENDING

    @property
    def safe(self) -> bool:
        """Whether `report.trajectory` may be executed."""
        return not self.reason

    @property
    def state(self) -> str:
        """One of 'not ready', 'held slowly', and those of DONE: 'held', 'refused'."""
        if self.done:
            return DONE[0] if self.safe else DONE[1]
        return 'not ready' if self.report is None else 'held slowly'


def proofs(replayed: Callable[..., ValidationReport | None], scene: Scene, plan: Plan,
           before: Shape | None) -> Iterator[Proof]:
    """Yield the Proof of a Plan after each step; the last one is `done`.

    Parameters
    ----------
    replayed : callable
        Takes the arguments of `replay`, returns its ValidationReport. If None, give up. Where it
        raises ProcessLost it is called again, three times at most.
    scene : Scene
        Scene in which the plan was made.
    plan : Plan
    before : Shape or None
        Shape before the first pose, or None.
    """
    workspace = scene.workspace
    slowly = {'simulator': scene.direct, 'plan': plan, 'initial': before, 'workspace': workspace,
              'obstacles': workspace.keep_out}
    moving = {**slowly, 'limits': scene.motion_limits, 'tolerance': scene.tolerance,
              'deadline': scene.deadline}
    known = None
    for step in (slowly, moving):
        try:
            report = persistent(partial(replayed, **step))
        except DeadlineExceeded:
            yield Proof(plan, known, 'no calm motion was found in threading.deadline = '
                        f'{scene.deadline:g} s of computing', True, Cause.PROOF_DEADLINE)
            return
        except ProcessLost as error:
            yield Proof(plan, known, f'tried {ATTEMPTS} times: {error}', True,
                        Cause.PROOF_PROCESS)
            return
        except Exception as error:  # whatever it is: the plan must not wait for ever
            name = '' if isinstance(error, DloPlannerError) else f'{type(error).__name__}: '
            yield Proof(plan, known, f'{name}{error}', True, Cause.PROOF_FAILED)
            return
        if report is None:
            return
        known = report
        if not report.converged:
            yield Proof(plan, report, _lost(report), True, Cause.NOT_FOLLOWED)
            return
        if step is moving:
            yield Proof(plan, report, report.reason, True,
                        Cause.NOT_CALM if report.reason else Cause.DONE)
        else:
            yield Proof(plan, report, _MOVED)


def _lost(report: ValidationReport) -> str:
    return ('replayed slowly, the DLO does not follow the plan: largest miss '
            f'{report.position_error:.3g} m, largest deviation {report.deviation:.3g} m, '
            f'smallest stability {report.stability:.3g}')
