# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 14: a wire goes through the centers of two cut-outs at once."""

from benchmarks.cases import hole, wire
from benchmarks.figures._drawing import BY_STEP, held, run, save, side, views
from dlo_planner import DirectSimulator, InverseSimulator

PLACES = ((0.0, 0.0, 1.0), (0.3, 0.0, 0.97))  # m: those of the paper are not known


def main(folder):
    """Make picture and table."""
    inverse = InverseSimulator(DirectSimulator(wire(1.5e-3)))
    plan = inverse.thread_two(*(hole(place) for place in PLACES))
    figure, ((axis,),) = views(1, 1, size=(8.4, 2.8))
    for k in range(0, len(plan), 2):
        side(axis, plan.shapes[k].positions, color=BY_STEP(k / len(plan)), lw=0.9)
        held(axis, plan.grippers[k], color=BY_STEP(k / len(plan)), lw=1.0, ms=2.5)
    for x, _, z in PLACES:
        for sign in (-1, 1):
            axis.plot([x, x], [z + 0.015 * sign, z + 0.12 * sign], color='0.4', lw=3)
    through = sum(len(passes) == 2 for passes in plan.via_points)
    save(figure, folder, 'fig14', 'Fig. 14: threading through two cut-outs, copper wire, '
         'd = 1.5 mm, L = 1 m', ['what', 'found'],
         [['waypoints', str(len(plan))], ['of these, in both cut-outs', str(through)],
          ['largest miss of a center [m]', f'{plan.position_error.max():.1e}'],
          ['least stability', f'{plan.stability.min():.3f}']],
         {'waypoints': len(plan), 'through': through, 'miss': float(plan.position_error.max()),
          'stability': float(plan.stability.min())})


if __name__ == '__main__':
    run(main)
