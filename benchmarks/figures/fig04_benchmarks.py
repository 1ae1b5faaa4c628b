# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 4: benchmarks A and B: a copper wire of 1 m bends by its weight, and with 1 kg more."""

import numpy as np

from benchmarks.cases import turned, wire
from benchmarks.figures._drawing import COLORS, held, run, save, side, views
from dlo_planner import DirectSimulator


def main(folder):
    """Make picture and table."""
    figure, ((axis,),) = views(1, 1)
    lines, found = [], {}
    for name, mass in (('A', 0.0), ('B', 1.0)):
        shape = DirectSimulator(wire(tip_mass=mass), accuracy=1e-6).solve(turned(0))
        tip, bend = shape.positions[-1], float(np.abs(shape.strains[0]).max())
        side(axis, shape.positions, color=COLORS[name], lw=2,
             label=f'{name}: {mass:g} kg at the tip' if mass else f'{name}: its own weight')
        slope = np.degrees(np.arctan2(-shape.tangents[-1, 2], shape.tangents[-1, 0]))
        lines.append([name, f'{tip[0]:.6f}', f'{tip[2]:.6f}', f'{bend:.2f}', f'{slope:.2f}'])
        found[name] = {'tip': [float(tip[0]), float(tip[2])], 'curvature': bend}
    held(axis, turned(0))
    axis.set(xlim=(-0.1, 0.75), ylim=(-0.02, 1.08))
    axis.legend(fontsize=8)
    save(figure, folder, 'fig04', 'Fig. 4: benchmarks A and B: copper wire, d = 1 mm, L = 1 m',
         ['benchmark', 'tip x [m]', 'tip z [m]', 'curvature at the gripper [1/m]',
          'slope of the tip [deg]'], lines, found)


if __name__ == '__main__':
    run(main)
