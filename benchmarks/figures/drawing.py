# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures and tables of one look."""

from textwrap import fill

import matplotlib

matplotlib.use('Agg')
from matplotlib import pyplot as plt  # noqa: E402  the backend has to be chosen first

from benchmarks import report  # noqa: E402

COLORS = dict(zip(('chebyshev', 'fourier', 'local', 'newton', 'dfp', 'downhill_simplex', 'A', 'B'),
                  ('C0', 'C1', 'C2', 'C0', 'C1', 'C3', 'C0', 'C3'), strict=True))


def axes(count=1, **more):
    """Return a figure and its axes, side by side."""
    figure, found = plt.subplots(1, count, figsize=(5.6 * count, 3.8), layout='constrained',
                                 squeeze=False, **more)
    for one in found[0]:
        one.grid(alpha=0.3, which='both')
    return figure, list(found[0])


def ticks(axis, values):
    """Mark these values on a logarithmic x axis, and no others."""
    axis.set_xticks(values, [f'{value:g}' for value in values])
    axis.xaxis.set_minor_formatter('')


def save(figure, folder, name, title, heads, lines, data):
    """Write picture, table and JSON; print the table."""
    folder.mkdir(parents=True, exist_ok=True)
    figure.suptitle(fill(title, 68 * len(figure.axes)), fontsize=10)
    figure.savefig(folder / f'{name}.png', dpi=110)
    plt.close(figure)
    text = report.markdown(heads, lines)
    print(f'{title}\n{text}', flush=True)
    report.write(folder, name, f'# {title}', f'![{title}]({name}.png)\n\n{text}', data)
