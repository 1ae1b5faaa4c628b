# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 12: what dependent computation gains from more tasks, from counted work."""

from benchmarks.figures._drawing import axes, run, save, ticks
from benchmarks.speculation import CASES, NAMES, speedups

TASKS = (1, 2, 3, 4, 8, 16)

_COLORS = ('C0', 'C1', 'C3')


def main(folder):
    """Make table and picture."""
    figure, all_axes = axes(len(CASES), sharey=True)
    found = {}
    for axis, (case, make) in zip(all_axes, CASES.items(), strict=True):
        for (method, name), color in zip(NAMES.items(), _COLORS, strict=True):
            recorded = {tasks: make(method, tasks) for tasks in TASKS}
            for ideal, look, text in ((True, 'o-', ''), (False, '.:', ', with messages')):
                gains = {n: float(gain) for n, gain, _ in speedups(recorded, method, ideal)}
                found[f'{case}: {name}{text}'] = gains
                axis.semilogx(list(gains), list(gains.values()), look, ms=4, color=color,
                              label=name + text)
        axis.axhline(1.0, color='0.5', lw=0.8)
        axis.set_title(case, fontsize=9)
        axis.set_xlabel('tasks $N_p$')
        ticks(axis, TASKS)
    all_axes[0].set_ylabel('speedup over one task')
    all_axes[0].legend(fontsize=7)
    save(figure, folder, 'fig12', 'Fig. 12: speedup of dependent computation, benchmark C '
         '(solid: messages and judging cost nothing)', ['case', *map(str, TASKS)],
         [[name, *(f'{gain:.2f}' for gain in row.values())] for name, row in found.items()], found)


if __name__ == '__main__':
    run(main)
