# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures and tables of one look."""

import sys
from pathlib import Path
from textwrap import fill

import matplotlib

matplotlib.use('Agg')
from matplotlib import pyplot as plt  # noqa: E402  the backend has to be chosen first

from benchmarks import report  # noqa: E402

COLORS = dict(zip(('chebyshev', 'fourier', 'local', 'newton', 'dfp', 'downhill_simplex', 'A', 'B'),
                  ('C0', 'C1', 'C2', 'C0', 'C1', 'C3', 'C0', 'C3'), strict=True))
BY_STEP = plt.get_cmap('viridis')  # of shapes that follow each other: from 0 to 1
plt.rcParams['svg.hashsalt'] = 'dlo_planner'  # the same picture is the same file


def axes(count=1, **more):
    """Return a figure and its axes, side by side."""
    figure, found = plt.subplots(1, count, figsize=(5.6 * count, 3.8), layout='constrained',
                                 squeeze=False, **more)
    for one in found[0]:
        one.grid(alpha=0.3, which='both')
    return figure, list(found[0])


def views(rows, columns, size=(5.6, 4.2), **more):
    """Return a figure and (rows, columns) axes of views along y: x and z in m, to one scale."""
    figure, found = plt.subplots(rows, columns, figsize=(size[0] * columns, size[1] * rows),
                                 layout='constrained', squeeze=False, **more)
    for one in found.flat:
        one.set_aspect('equal')
        one.grid(alpha=0.3)
        one.set_xlabel('x [m]')
        one.set_ylabel('z [m]')
        if 'sharex' in more:
            one.label_outer()
    return figure, found


def scale(figure, axes_drawn, values, label):
    """Say beside axes what the colors of shapes mean, from the first value to the last."""
    known = plt.cm.ScalarMappable(plt.Normalize(values[0], values[-1]), BY_STEP)
    return figure.colorbar(known, ax=axes_drawn, label=label, fraction=0.04, pad=0.02)


def ticks(axis, values):
    """Mark these values on a logarithmic x axis, and no others."""
    axis.set_xticks(values, [f'{value:g}' for value in values])
    axis.xaxis.set_minor_formatter('')


def side(axis, points, **look):
    """Draw points (n, 3) as a line, seen along y."""
    look = {'lw': 1.2} | look
    return axis.plot(points[:, 0], points[:, 2], **look)[0]


def held(axis, gripper, length=0.06, **look):
    """Draw where a gripper is, and a short line along it."""
    back = gripper.position - length * gripper.rotation[:, 0]
    look = {'color': 'k', 'lw': 1.5, 'marker': 's', 'ms': 3.5, 'markevery': [1]} | look
    axis.plot([back[0], gripper.position[0]], [back[2], gripper.position[2]], **look)


def picture(figure, folder, name, title):
    """Write a picture as PNG and SVG."""
    folder.mkdir(parents=True, exist_ok=True)
    width = max(40, int(13 * figure.get_figwidth()))
    figure.suptitle(fill(title, width), fontsize=10)
    figure.savefig(folder / f'{name}.png', dpi=110)
    figure.savefig(folder / f'{name}.svg', metadata={'Date': None})
    plt.close(figure)


def save(figure, folder, name, title, heads, lines, data):
    """Write picture, table and JSON; print the table."""
    picture(figure, folder, name, title)
    text = report.markdown(heads, lines)
    print(f'{title}\n{text}', flush=True)
    report.write(folder, name, f'# {title}', f'![{title}]({name}.png)\n\n{text}', data)


def run(main):
    """Make a figure by itself: its script is called with the folder that it goes to."""
    main(Path(sys.argv[1] if len(sys.argv) > 1 else 'figures_output'))
