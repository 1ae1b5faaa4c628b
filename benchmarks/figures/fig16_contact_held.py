# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 16: gripper poses that hold the same contact: the solution is not unique."""

from benchmarks.cases import level, wire
from benchmarks.figures._drawing import run, save, views
from benchmarks.figures.fig15_contact_drawn import PLACE, RADIUS, bar, draw
from dlo_planner import DirectSimulator, InverseSimulator

_LENGTH = 0.6  # m, of the contact


def main(folder):
    """Make picture and table."""
    inverse = InverseSimulator(DirectSimulator(wire(1.5e-3), basis='local', obstacles=[bar()]))
    plan = inverse.hold_contact(level(PLACE[2] + RADIUS, PLACE[0]), _LENGTH, condition=None)
    again = inverse.simulator.track(plan.grippers, initial=plan.shapes[0])
    touched = [max(shape.contacts, key=lambda one: one.force) for shape in again]
    forces = [contact.force for contact in touched]
    figure, ((axis,),) = views(1, 1, size=(8.4, 4.4))
    draw(axis, plan)
    off = max(abs(contact.s - _LENGTH) for contact in touched)
    drift = max(abs(shape.frame_at(contact.s)[0][2, 0])
                for shape, contact in zip(again, touched, strict=True))
    save(figure, folder, 'fig16', f'Fig. 16: all of these hold the wire level on the bar at '
         f's = {_LENGTH:g} m; copper wire, d = 1.5 mm, L = 1 m', ['what', 'found'],
         [['gripper poses', str(len(plan))],
          ['force of contact [N]', f'{min(forces):.3f} to {max(forces):.3f}'],
          ['simulated: contact off along the wire [m]', f'{off:.1e}'],
          ['simulated: slope at the contact [rad]', f'{drift:.1e}']],
         {'poses': len(plan), 'forces': [float(force) for force in forces], 'off': float(off),
          'drift': float(drift)})


if __name__ == '__main__':
    run(main)
