# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""`dlo-planner replay`: the proof of a plan."""

from pathlib import Path

import click

from dlo_planner.cli.arguments import READ, Described, described, written
from dlo_planner.cli.outputs import PICTURES, VALUES, checked
from dlo_planner.cli.thread import proved
from dlo_planner.plan.plan import Plan

_ENDINGS = (*PICTURES, *VALUES, '.csv')


@click.command('replay')
@described
@click.argument('plan', type=READ)
@written('.png .svg .pdf the picture, .npz .json the report (ValidationReport.load reads it), '
         '.csv its figures')
def command(dlo: Described, plan: Path, outputs: tuple[Path, ...]) -> None:
    """Run a saved plan through the direct simulator: slowly, and in motion as it is executed.

    CONFIG describes the DLO, as for "dlo-planner thread": the planner's own, or a better known one.
    PLAN is a file that "dlo-planner thread -o plan.npz" or Plan.save wrote. The parameters
    threading.* say the limits of the motion, and by how much it may miss (threading.tolerance).

    \b
    Examples:
      dlo-planner replay rubber_hose plan.npz
      dlo-planner replay rubber_hose plan.npz -p rod.youngs_modulus=7e6 -o report.png -o report.csv

    Exit code 3: the plan must not be executed; the reason is in the table.
    """
    checked(outputs, _ENDINGS)
    raise SystemExit(proved(dlo, Plan.load(plan), outputs))
