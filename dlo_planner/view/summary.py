# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables of what matters in an answer, as rows and as text."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.grasp import grasped_at
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.section_forces import SectionForces
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.fit import Fit
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import named
from dlo_planner.model.rod import Rod, Surface
from dlo_planner.model.value import Value
from dlo_planner.plan.path import held_after
from dlo_planner.plan.plan import Plan, greatest_push, rooms_in_holes
from dlo_planner.trajectory.trajectory import Trajectory
from dlo_planner.verify.report import ValidationReport
from dlo_planner.verify.robustness import Robustness

Row = tuple[str, str, str]  # quantity, value, unit
PART = 0.95  # of the samples of a Robustness
_UNITS = {
    'position_error': 'm', 'misalignment': 'rad', 'contact_force': 'N', 'clearance': 'm',
    'deviation': 'm', 'max_tracking_error': 'm', 'swing': 'm', 'arrival': 'm', 'departure': 'm',
    'dynamic_clearance': 'm', 'dynamic_contact_force': 'N', 'insertion_force': 'N',
    'duration': 's', 'step': 's', 'workspace_margin': 'm',
    'bend_margin': '1/m', 'tolerance': 'm'}


def rows_of(value: Value) -> list[Row]:
    """Return the rows of a value: (quantity, value, unit), all of them texts."""
    return _ROWS[kind_of(value, _ROWS)](value)


def kind_of(value: Value, known: Mapping[str, object]) -> str:
    """Return the name among `known` of a value's class: `parallel` stands beside this room."""
    return next((cls.__name__ for cls in type(value).__mro__ if cls.__name__ in known), '')


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


def _shape_rows(shape: Shape) -> list[Row]:
    force = np.linalg.norm(shape.gripper_wrench.reshape(2, 3), axis=1)
    rows = [
        ('status', shape.status, ''),
        ('length', figure(shape.s[-1]), 'm'),
        ('elements', str(len(shape.element_strains)), ''),
        ('gripper', _point(shape.gripper.position), 'm'),
        *_held_rows(shape), ('far end', _point(shape.positions[-1]), 'm'),
        *_hold_rows(shape),
        ('sharpest bend, radius', figure(shape.bend_radius.min()), 'm'), *_most_inside(shape),
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
    if shape.self_contacts:
        rows += [('touches itself', str(len(shape.self_contacts)), ''),
                 ('largest force on itself',
                  figure(max(one.force for one in shape.self_contacts)), 'N')]
    if shape.contacts:
        rows += [('contacts', str(len(shape.contacts)), ''),
                 ('largest contact force', figure(max(one.force for one in shape.contacts)), 'N'),
                 *_touch_rows(shape)]
    return rows


def _most_inside(shape: Shape) -> list[Row]:
    """Return the largest forces and moments inside a DLO, and where they are."""
    try:
        inside = shape.section_forces
    except InvalidTask:  # in motion, not converged, or from a file
        inside = None
    return [(f'{name}, largest', *(('not looked at', unit) if inside is None
                                   else _largest(values(inside), inside.s, unit)))
            for name, unit, values in _INSIDE]


_INSIDE: tuple[tuple[str, str, Callable[[SectionForces], Floats]], ...] = (
    ('tension', 'N', lambda inside: inside.tension),
    ('compression', 'N', lambda inside: -inside.tension),
    ('shear force', 'N', lambda inside: np.linalg.norm(inside.shear, axis=1)),
    ('bending moment', 'N m',
     lambda inside: np.linalg.norm(inside.bending_moment, axis=1)),
    ('torque', 'N m', lambda inside: np.abs(inside.torque)))


def _largest(values: Floats, s: Floats, unit: str) -> tuple[str, str]:
    at = int(values.argmax())
    return (figure(values[at]), f'{unit}, at {figure(s[at])} m') if values[at] > 0 else ('0', unit)


_MOST_TOUCHED = 5  # obstacles of a table of rows: those that are pressed most


def _touch_rows(shape: Shape) -> list[Row]:
    """Return how a DLO lies on each obstacle, and what it presses those with that have a name."""
    if not shape.obstacles:
        return []
    most = sorted(shape.touches, key=lambda one: -one.pressed)[:_MOST_TOUCHED]
    rows = []
    for one in most:
        rows.append((str(one), '', ''))
        if shape.obstacles[one.obstacle].name:
            rows.append((f'presses {one.name} with', figure(one.pressed), 'N'))
    return rows


def _held_rows(shape: Shape) -> list[Row]:
    """Return where a gripper holds a DLO inside; no row of one that is held at its beginning."""
    at = grasped_at(shape)
    return [] if at is None else [('held, from its beginning', figure(at), 'm')]


def _hold_rows(shape: Shape) -> list[Row]:
    """Return what each hold of a Shape bears."""
    rows = []
    for hold, wrench in zip(shape.holds, shape.wrenches, strict=True):
        size = np.linalg.norm(wrench.reshape(2, 3), axis=1)
        name = f'{named(hold)}, {hold.grip}'
        rows += [(f'{name}, force', figure(size[0]), 'N'),
                 (f'{name}, moment', figure(size[1]), 'N m')]
    return rows


def _plan_rows(plan: Plan) -> list[Row]:
    rows = [('status', plan.status.value, ''), ('waypoints', str(len(plan)), '')]
    if not len(plan):
        return rows
    rows += [
        ('duration at the plan\'s speeds', figure(plan.times[-1]), 's'),
        ('depth, first to last', f'{plan.depths[0]:.4g} to {plan.depths[-1]:.4g}', 'm'),
        ('gripper, first', _point(plan.grippers[0].position), 'm'),
        ('gripper, last', _point(plan.grippers[-1].position), 'm'), *_held_rows(plan.shapes[0])]
    for name, poses in plan.arms.items():
        rows += [(f'{name}, first', _point(poses[0].position), 'm'),
                 (f'{name}, last', _point(poses[-1].position), 'm')]
    if len(plan.stages) > 1:
        rows.append(('stages', ', '.join(stage.name for stage in plan.stages), ''))
    rows += [('before ' + plan.stages[event.stage].name, str(event), '') for event in plan.events]
    return rows + [(name, figure(worst), unit) for name, _, worst, unit in plan_columns(plan)]


def plan_columns(plan: Plan) -> list[tuple[str, Floats, float, str]]:
    """Return what there is to say of each waypoint: (quantity, values (n,), worst, unit)."""
    room = rooms_in_holes(plan).min(axis=1, initial=np.inf)
    columns: list[tuple[str, Floats, Callable[[Floats], Any], str]] = [
        ('miss', plan.position_error, np.max, 'm'),
        ('misalignment', np.rad2deg(plan.misalignment), np.max, 'deg'),
        ('room in the cut-outs', room, np.min, 'm'), ('clearance', plan.clearance, np.min, 'm'),
        ('bend margin', plan.bend_margin, np.min, '1/m'),
        ('stability', plan.stability, np.min, ''), ('residual', plan.residual, np.max, '')]
    if np.isfinite(plan.margin).any():
        columns.append(('margin', plan.margin, np.nanmin, 'm'))
    if np.isfinite(plan.yield_utilization).any():
        columns.append(('yield limit used', plan.yield_utilization, np.max, ''))
    if held_after(plan) is None and any(shape.holds for shape in plan.shapes):
        columns += [('force of a grip', plan.largest_force, np.max, 'N'),
                    ('moment of a grip', plan.largest_moment, np.max, 'N m')]
    if plan.plug is not None:
        columns += [('force at the plug\'s front', plan.plug_force, np.fmax.reduce, 'N'),
                    ('moment at the plug\'s front', plan.plug_moment, np.fmax.reduce, 'N m')]
    if held_after(plan) is not None:
        _, unknown = greatest_push(plan)
        columns.append(('push into the bore, estimated' + (unknown and f' ({unknown})'),
                        plan.insertion_force, np.fmax.reduce, 'N'))
    return [(name, values, float(worst(values)), unit) for name, values, worst, unit in columns]


def _motion_rows(motion: Motion) -> list[Row]:
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


def _report_rows(report: ValidationReport) -> list[Row]:
    rows = [('safe', 'yes' if report.safe else 'no', '')]
    if not report.safe:
        rows.append(('reason', report.reason, ''))
    rows.append(('converged', 'yes' if report.converged else 'no', ''))
    names = [item.name for item in fields(report)
             if isinstance(getattr(report, item.name), float)]
    return rows + [(name.replace('_', ' '), figure(getattr(report, name)), _UNITS.get(name, ''))
                   for name in names]


def _fit_rows(fit: Fit) -> list[Row]:
    """Return the rows of a Fit: each number with its standard deviation."""
    numbers, spread = (flat(values) for values in (fit.values, fit.deviations))
    return [('status', fit.status, ''),
            ('misfit', figure(fit.misfit), 'm'), ('noise', figure(fit.noise), 'm'),
            *([] if fit.birge_ratio == 1 else [
                ('off by, of what the noise tells', figure(fit.birge_ratio), 'times')]),
            *(_deviating(*row) for row in zip(fit.names, numbers, spread, strict=True))]


def _estimate_rows(estimate: Estimate) -> list[Row]:
    """Return the rows of an Estimate; logarithms of factors, 1/m, rad, m."""
    return [('looks', str(estimate.looks), ''),
            ('last look could be used', 'yes' if estimate.converged else 'no', ''),
            ('misfit', figure(estimate.misfit), 'm'),
            ('outliers', figure(estimate.outliers), ''),
            ('normalized innovation', figure(estimate.normalized_innovation), ''),
            *(_deviating(name, value, estimate.deviations[name])
              for name, value in estimate.values.items())]


def _robustness_rows(robust: Robustness) -> list[Row]:
    """Return the rows of a Robustness: the worst of all waypoints."""
    rows = [('waypoints', str(robust.first_order.size), ''),
            ('miss by all, root mean square', figure(robust.first_order.max(initial=0)), 'm'),
            *((f'miss by {name.replace("_", " ")}', figure(values.max(initial=0)), 'm')
              for name, values in zip(robust.causes, robust.by_cause.T, strict=True)),
            ('samples', str(len(robust.sampled)), '')]
    if len(robust.plug_wrenches) and not np.isnan(robust.plug_wrenches).all():
        force, moment = np.linalg.norm(robust.plug_wrenches.reshape(-1, 2, 3), axis=2).max(axis=0)
        rows += [('force at the plug\'s front, root mean square error', figure(force), 'N'),
                 ('moment at the plug\'s front, root mean square error', figure(moment), 'N m')]
    if len(robust.sampled):
        rows.append((f'miss of {PART:.0%} of them', figure(robust.quantile(PART).max()), 'm'))
    return [*rows, ('part of them that gets through', figure(robust.success), '')]


def _trajectory_rows(trajectory: Trajectory) -> list[Row]:
    """Return the rows of a Trajectory: what it keeps, and what the DLO does in it."""
    times = np.linspace(0.0, trajectory.duration, 1000)
    _, velocities, accelerations = trajectory.at(times)
    rows = [('status', trajectory.status, ''), ('duration', figure(trajectory.duration), 's'),
            ('within limits alone', figure(trajectory.least_duration), 's'),
            ('slowest vibration on the way, period', figure(trajectory.slowest_period), 's'),
            ('legs between stops', str(len(trajectory.path.legs)), '')]
    for name, values, unit in (('speed', velocities, 's'), ('acceleration', accelerations, 's^2')):
        for kind, part, first in (('linear', values[:, :3], 'm'),
                                  ('angular', values[:, 3:], 'rad')):
            limit = getattr(trajectory.limits, f'{kind}_{name}')
            most = np.linalg.norm(part, axis=1).max()
            rows.append((f'{kind} {name}, largest and limit',
                         f'{figure(most)} of {figure(limit)}', f'{first}/{unit}'))
    if trajectory.motion is not None:
        rows += [('miss in motion', figure(trajectory.motion.position_error), 'm'),
                 ('clearance in motion', figure(trajectory.motion.clearance), 'm'),
                 ('swing', figure(trajectory.motion.swing), 'm')]
    return [*rows, ('tolerance', figure(trajectory.tolerance), 'm'),
            ('frequencies may be off by', figure(trajectory.mode_margin), '')]


def _map_rows(capability: Any) -> list[Row]:
    """Return the rows of a CapabilityMap: how often there was which outcome."""
    outcomes, counts = np.unique(capability.outcome, return_counts=True)
    return [(str(outcome) or 'not looked at', str(count), 'cut-outs')
            for outcome, count in zip(outcomes, counts, strict=True)]


def _shapes_rows(shapes: Any) -> list[Row]:
    """Return the rows of Shapes: the worst of all."""
    rows = [('shapes', str(len(shapes)), ''), ('converged', str(int(shapes.converged.sum())), ''),
            ('jumped', str(int(shapes.jumped.sum())), ''),
            ('contacts', str(len(shapes.contact_table)), '')]
    if not len(shapes):
        return rows
    force, moment = np.linalg.norm(shapes.gripper_wrench.reshape(-1, 2, 3), axis=2).max(axis=0)
    return [*rows, ('residual, largest', figure(shapes.residual.max()), ''),
            ('stability, least', figure(shapes.stability.min()), ''),
            ('gripper bears at most, force', figure(force), 'N'),
            ('gripper bears at most, moment', figure(moment), 'N m')]


_FITTED = {'bending_stiffness': 'N m^2', 'torsional_stiffness': 'N m^2', 'natural_curvature': '1/m',
           'natural_twist': '1/m', 'mass_per_length': 'kg/m', 'tip_mass': 'kg', 'damping[0]': '1/s',
           'damping[1]': 's'}


def unit_of(name: str) -> str:
    """Return the unit of a number of a Fit by its name, as 'natural_curvature[0]'."""
    return _FITTED.get(name, _FITTED.get(name.split('[', maxsplit=1)[0], ''))


def _grasp_rows(found: Any) -> list[Row]:
    """Return the rows of a GraspMap: how often there was which outcome, and the best."""
    outcomes, counts = np.unique(found.outcome, return_counts=True)
    rows = [(str(outcome) or 'not looked at', str(count), 'ways to hold')
            for outcome, count in zip(outcomes, counts, strict=True)]
    if found.best is not None:
        grasp = found.grasps[found.best[0]]
        rows += [('best grasp', figure(grasp) if isinstance(grasp, float) else _point(
            grasp.position), 'm'), ('its margin', figure(found.margin[found.best]), '')]
    return rows


def _deviating(name: str, number: float, deviation: float) -> Row:
    said = (f'+- {deviation:.2g}' if np.isfinite(deviation)
            else 'not resolvable from the observations')
    return name, figure(number), f'{said} {unit_of(name)}'.rstrip()


def flat(values: Mapping[str, Any]) -> Floats:
    """Return numbers and arrays by name as one row."""
    return np.concatenate([np.ravel(one).astype(float) for one in values.values()])


def _inside_rows(inside: SectionForces) -> list[Row]:
    """Return the rows of SectionForces: the largest of each."""
    return [*((f'{name}, largest', *_largest(values(inside), inside.s, unit))
              for name, unit, values in _INSIDE),
            ('forces leave over', figure(inside.imbalance), 'N')]


_ROWS: dict[str, Callable[[Any], list[Row]]] = {
    'Shape': _shape_rows, 'SectionForces': _inside_rows, 'Plan': _plan_rows, 'Motion': _motion_rows,
    'ValidationReport': _report_rows, 'Fit': _fit_rows, 'Estimate': _estimate_rows,
    'Robustness': _robustness_rows, 'Trajectory': _trajectory_rows, 'CapabilityMap': _map_rows,
    'GraspMap': _grasp_rows,
    'Shapes': _shapes_rows}
