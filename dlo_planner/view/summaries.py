# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables of what matters in an answer, as rows and as text."""

from collections.abc import Iterable, Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats
from dlo_planner.model.rod import Rod, Surface
from dlo_planner.model.value import Value
from dlo_planner.plan.plan import Plan
from dlo_planner.verify.report import ValidationReport

Row = tuple[str, str, str]  # quantity, value, unit
_UNITS = {
    'position_error': 'm', 'misalignment': 'rad', 'contact_force': 'N', 'clearance': 'm',
    'deviation': 'm', 'max_tracking_error': 'm', 'swing': 'm', 'arrival': 'm', 'departure': 'm',
    'dynamic_clearance': 'm', 'dynamic_contact_force': 'N', 'insertion_force': 'N',
    'duration': 's', 'step': 's', 'workspace_margin': 'm',
    'bend_margin': '1/m', 'tolerance': 'm'}


def rows_of(value: Shape | Plan | Motion | ValidationReport) -> list[Row]:
    """Return the rows of a value: (quantity, value, unit), all of them texts."""
    if isinstance(value, Shape):
        return _of_shape(value)
    if isinstance(value, Plan):
        return _of_plan(value)
    return _of_motion(value) if isinstance(value, Motion) else _of_report(value)


def heading(value: Value) -> str:
    """Return the line that a table begins with: what it is, and of which DLO, where that is known.

    A shape or a plan from a file knows none.
    """
    kind = repr(value).split('(', 1)[0]
    rod = getattr(value, 'rod', None)
    if isinstance(rod, Rod) and not isinstance(value, Shape):
        return f'{kind} of {rod_line(rod)}'
    shapes = (value,) if isinstance(value, Shape) else getattr(value, 'shapes', ())
    mesh = next((shape.state.mesh for shape in shapes), None)
    if mesh is None:
        return kind
    return f'{kind} of {rod_line(mesh.surroundings.rod, mesh.surroundings.gravity)}'


def rod_line(rod: Rod, gravity: ArrayLike = (0.0, 0.0, -9.81), name: str = 'a DLO') -> str:
    """Return what a Rod is in a line: sizes, mass, stiffness, and how far its weight bends it.

    Of what varies along s: as it is in the middle.
    """
    middle = [0.5 * rod.length]
    mass, = rod.masses_per_length(middle)
    (twist, *bend), = rod.stiffnesses(middle)
    half = Surface.of(rod)
    size = ('no thickness' if rod.radius is None else f'diameter {2e3 * half.radius:.4g} mm'
            if half.half is None else ' x '.join(f'{2e3 * one:.4g}' for one in half.half) + ' mm')
    weight = mass * np.linalg.norm(np.asarray(gravity, dtype=float))
    stiffness = ', '.join(f'{one:.4g}' for one in dict.fromkeys(bend))
    return (f'{name}: {rod.length:.4g} m, {size}, {1e3 * mass:.4g} g/m, EI {stiffness} N m^2, '
            f'GJ {twist:.4g} N m^2, w L^3/EI {weight * rod.length**3 / min(bend):.4g}')


def text_table(head: str, rows: Sequence[Row]) -> str:
    """Return rows as lines of text, their columns aligned, under a heading."""
    name = max((len(row[0]) for row in rows), default=0)
    value = max((len(row[1]) for row in rows), default=0)
    lines = [f'  {one:<{name}}  {text:>{value}}  {unit}'.rstrip() for one, text, unit in rows]
    return '\n'.join([head, *lines])


def figure(number: float) -> str:
    """Return a number in four digits; an infinite one or nan as a word."""
    if np.isnan(number):
        return 'not looked at'
    if np.isinf(number):
        return 'no limit' if number > 0 else '-inf'
    return f'{number:.4g}'


def _point(position: Iterable[float]) -> str:
    return ', '.join(f'{0.0 + round(value, 12):.4g}' for value in position)


def _of_shape(shape: Shape) -> list[Row]:
    force = np.linalg.norm(shape.gripper_wrench.reshape(2, 3), axis=1)
    rows = [
        ('status', shape.status, ''),
        ('length', figure(shape.s[-1]), 'm'),
        ('elements', str(len(shape.element_strains)), ''),
        ('gripper', _point(shape.gripper.position), 'm'),
        ('far end', _point(shape.positions[-1]), 'm'),
        ('sharpest bend, radius', figure(shape.bend_radius.min()), 'm'),
        ('gripper bears, force', figure(force[0]), 'N'),
        ('gripper bears, moment', figure(force[1]), 'N m'),
        ('elastic energy', figure(shape.elastic_energy), 'J'),
        ('residual', figure(shape.residual), ''),
        ('stability', figure(shape.stability), ''),
        ('error estimate', figure(shape.error_estimate), 'm')]
    if np.isfinite(shape.bend_margin):
        rows.append(('margin to the sharpest bend allowed', figure(shape.bend_margin), '1/m'))
    if np.isfinite(shape.self_distance):
        rows.append(('axis from itself', figure(shape.self_distance), 'm'))
    if shape.contacts:
        rows += [('contacts', str(len(shape.contacts)), ''),
                 ('largest contact force', figure(max(one.force for one in shape.contacts)), 'N')]
    return rows


def _of_plan(plan: Plan) -> list[Row]:
    rows = [('status', plan.status.value, ''), ('waypoints', str(len(plan)), '')]
    if not len(plan):
        return rows
    rows += [
        ('duration at the plan\'s speeds', figure(plan.times[-1]), 's'),
        ('depth, first to last', f'{plan.depths[0]:.4g} to {plan.depths[-1]:.4g}', 'm'),
        ('gripper, first', _point(plan.grippers[0].position), 'm'),
        ('gripper, last', _point(plan.grippers[-1].position), 'm')]
    return rows + [(name, figure(worst), unit) for name, _, worst, unit in plan_columns(plan)]


def plan_columns(plan: Plan) -> list[tuple[str, Floats, float, str]]:
    """Return what there is to say of each waypoint: (quantity, values (n,), worst, unit)."""
    rim = plan.clearances[:, :, 0].min(axis=1, initial=np.inf)
    columns = [('miss', plan.position_error, np.max, 'm'),
               ('misalignment', np.rad2deg(plan.misalignment), np.max, 'deg'),
               ('room at the rim', rim, np.min, 'm'), ('clearance', plan.clearance, np.min, 'm'),
               ('bend margin', plan.bend_margin, np.min, '1/m'),
               ('stability', plan.stability, np.min, ''), ('residual', plan.residual, np.max, '')]
    if any(shape.far_end is not None for shape in plan.shapes):
        columns.append(('push into the bore, estimated', plan.insertion_force, np.max, 'N'))
    return [(name, values, float(worst(values)), unit) for name, values, worst, unit in columns]


def _of_motion(motion: Motion) -> list[Row]:
    rows = [('status', motion.status, ''), ('instants', str(len(motion)), '')]
    if motion.message:
        rows.append(('message', motion.message, ''))
    if not len(motion):
        return rows
    tip = np.linalg.norm(motion.velocities[:, -1], axis=1)
    return rows + [
        ('duration', figure(motion.times[-1] - motion.times[0]), 's'),
        ('far end, last', _point(motion.shapes[-1].positions[-1]), 'm'),
        ('largest speed of the far end', figure(tip.max()), 'm/s'),
        ('work of the gripper', figure(_last(motion.work)), 'J'),
        ('dissipated', figure(_last(motion.dissipated)), 'J'),
        ('numerical loss', figure(_last(motion.numerical_loss)), 'J'),
        ('tolerance', figure(motion.tolerance), 'm')]


def _last(values: Floats | None) -> float:
    return np.nan if values is None else float(values[-1])


def _of_report(report: ValidationReport) -> list[Row]:
    rows = [('safe', 'yes' if report.safe else 'no', '')]
    if not report.safe:
        rows.append(('reason', report.reason, ''))
    rows.append(('converged', 'yes' if report.converged else 'no', ''))
    names = [item.name for item in fields(report)
             if isinstance(getattr(report, item.name), float)]
    return rows + [(name.replace('_', ' '), figure(getattr(report, name)), _UNITS.get(name, ''))
                   for name in names]
