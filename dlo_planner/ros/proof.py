"""The proof of a plan, step by step: slowly, which is known quickly, then as it is executed."""

from dataclasses import dataclass

from dlo_planner.errors import DeadlineExceeded, DloPlannerError
from dlo_planner.inverse.plan import Plan
from dlo_planner.inverse.replay import Report

DONE = ('held', 'refused')  # states of a proof that has no step left
_CHECKED = 'the plan is still being checked: ask again'
_MOVED = 'the motion along the plan is still being made and checked: ask again'


@dataclass(frozen=True)
class Proof:
    """How far the proof of a plan has come, and what it says.

    Attributes:
        plan: Plan
        report: Report, of the last step that was done, or None
        reason: why its trajectory must not be executed; empty: it may be
        done: whether no step is left
    """

    plan: Plan
    report: Report | None = None
    reason: str = _CHECKED
    done: bool = False

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


def proofs(replayed, scene, plan, before):
    """Yield the Proof of a Plan after each step; the last one is `done`.

    Args:
        replayed: takes the arguments of `replay`, returns its Report; None: give up
        scene: Scene in which the plan was made
        plan: Plan
        before: Shape before the first pose, or None
    """
    workspace = scene.inverse.workspace
    slowly = {'simulator': scene.direct, 'plan': plan, 'initial': before, 'workspace': workspace,
              'obstacles': workspace.keep_out}
    moving = {**slowly, 'limits': scene.limits, 'tolerance': scene.tolerance,
              'deadline': scene.deadline}
    known = None
    for step in (slowly, moving):
        try:
            report = replayed(**step)
        except DeadlineExceeded:
            yield Proof(plan, known, 'no calm motion was found in threading.deadline = '
                        f'{scene.deadline:g} s of computing', True)
            return
        except Exception as error:  # whatever it is: the plan must not wait for ever
            name = '' if isinstance(error, DloPlannerError) else f'{type(error).__name__}: '
            yield Proof(plan, known, f'{name}{error}', True)
            return
        if report is None:
            return
        known = report
        if not report.converged:
            yield Proof(plan, report, _lost(report), True)
            return
        last = step is moving
        yield Proof(plan, report, report.reason if last else _MOVED, last)


def _lost(report):
    return ('replayed slowly, the DLO does not follow the plan: largest miss '
            f'{report.miss:.3g} m, largest deviation {report.deviation:.3g} m, smallest stability '
            f'{report.stability:.3g}')
