# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All parameters: one table, for the node, the YAML files in config/ and the command line."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import shown


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter: its default (which fixes the type), meaning, limits, and if it may change."""

    default: Any
    description: str
    lowest: float | None = None
    highest: float | None = None
    read_only: bool = False
    while_executing: bool = False  # whether it may change then

    @property
    def unit(self) -> str:
        """The SI unit that its description names, '' if it has none."""
        found = _UNIT.search(self.description)
        return '' if found is None else found[1] or 's'


_ANY = float('inf')
# a unit after a comma; what begins with seconds is in seconds
_UNIT = re.compile(r', (kg/m\^3|kg/m|kg|N m\^2|1/m|1/s|m/s\^[23]|m/s|rad/s\^[23]|rad/s|rad|Pa|m|s)'
                   r'(?=[.,;: ])|^Seconds\b')
_READ_ONLY = {'frame_id', 'diagnostics_period', 'autostart', 'execute.rate'}
_WHILE_EXECUTING = {  # may change while a plan is executed
    'rod.name', 'task', 'threading.waypoints', 'threading.deepest', 'threading.standoff',
    'threading.gripper_clearance', 'threading.max_misalignment', 'threading.margin',
    'threading.tolerance', 'threading.deadline',
    'threading.planning_deadline', 'arm.packages', 'arm.self_clearance', 'arm.deadline',
    'markers.color', 'execute.start_distance', 'execute.start_angle'}
# name -> default, which fixes the type; what it means; least, largest
_TABLE: dict[str, tuple[Any, ...]] = {
    'frame_id': ('world', 'Frame of all poses in and out, z up.'),
    'diagnostics_period': (1.0, 'Seconds between messages on /diagnostics.', 0.05, 60.0),
    'rod.name': ('copper wire', 'Name of the DLO, in the log and on diagnostics.'),
    'rod.section': ('round', 'Section: round | tube | rectangular (density, youngs_modulus, '
                             'poisson_ratio and sizes are used) | stiffness (mass_per_length, '
                             'bending_stiffness, torsional_stiffness are used).'),
    'rod.length': (1.0, 'Length between gripper and free end, m.', 0.001, 100.0),
    'rod.diameter': (0.001, 'Outer diameter (round, tube; elsewhere for pictures), m.', 1e-5, 1.0),
    'rod.inner_diameter': (0.0, 'Inner diameter of a tube, m.', 0.0, 1.0),
    'rod.width': (0.01, 'Width along the n axis (rectangular), m.', 1e-5, 1.0),
    'rod.thickness': (0.001, 'Thickness along the b axis (rectangular), m.', 1e-5, 1.0),
    'rod.density': (8960.0, 'Density, kg/m^3.', 0.0, 30000.0),
    'rod.youngs_modulus': (110e9, "Young's modulus, Pa.", 1000.0, 1e13),
    'rod.poisson_ratio': (0.34, 'Poisson ratio.', -0.99, 0.5),
    'rod.mass_per_length': (0.007, 'Mass per length (section: stiffness), kg/m.', 0.0, 1000.0),
    'rod.bending_stiffness': ([0.0054, 0.0054], 'EI_n, EI_b (section: stiffness), N m^2.'),
    'rod.torsional_stiffness': (0.004, 'GJ (section: stiffness), N m^2.', 1e-12, 1e9),
    'rod.natural_curvature': ([0.0, 0.0], 'Stress-free curvature k_n, k_b, 1/m.'),
    'rod.natural_curvature_terms': ([0.0, 0.0], 'What is added to it along s: pairs (about n, '
                                                'about b) of coefficients of the Legendre '
                                                'polynomials P_1, P_2, ... of 2 s / length - 1, '
                                                '1/m.'),
    'rod.natural_twist': (0.0, 'Stress-free torsion, 1/m.', -10000.0, 10000.0),
    'rod.tip_mass': (0.0, 'Mass at the free end, kg.', 0.0, 1000.0),
    'rod.point_masses': ([0.0, 0.0], 'Further masses: pairs (place s from the gripper, m; mass, '
                                     'kg).'),
    'rod.point_loads': ([0.0] * 4, 'Dead forces on the DLO: fours (s, m; force in the world, N); s '
                                   'at the length: the tip.'),
    'rod.plug.length': (0.0, 'Length of a rigid body fixed to the free end, beyond rod.length, m; '
                             '0 = there is none.', 0.0, 10.0),
    'rod.plug.mass': (0.0, 'Its mass, kg.', 0.0, 1000.0),
    'rod.plug.radius': (0.0, 'Its radius, m; 0 = as thick as the DLO.', 0.0, 1.0),
    'rod.grasped_at': (0.0, 'Where along the DLO the gripper holds it, m from its beginning, both '
                            'ends free: shapes are predicted, and what is in front of it is '
                            'threaded through one cut-out; 0 = at its beginning.', 0.0, 100.0),
    'rod.damping': ([0.0, 0.0], 'Rayleigh damping in motion: 1/s times mass, s times stiffness.'),
    'rod.yield_stress': (0.0, 'Stress at which it yields (sections), Pa; 0 = never.', 0.0, 1e12),
    'rod.yield_curvature': ([0.0, 0.0], 'Curvatures about n and b at which it yields (section: '
                                        'stiffness), 1/m; 0 = never.'),
    'rod.yield_torsion': (0.0, 'Torsion at which it yields (section: stiffness), 1/m; 0 = '
                               'never.', 0.0, 1e6),
    'rod.section_model': ('', 'How it goes on yielding: fibers | round | rectangular | ideal; '
                              'empty: fibers of a section, ideal without.'),
    'rod.hardening': (0.0, 'Part of the stiffness that never yields.', 0.0, 0.999),
    'rod.max_bend_curvature': (0.0, 'Curvature that no plan may exceed, 1/m; 0 = any.', 0.0, 1e6),
    'gravity': ([0.0, 0.0, -9.81], 'Gravity in the world frame, m/s^2.'),
    'simulator.basis': ('chebyshev', 'How a shape is written: chebyshev | fourier | local.'),
    'simulator.n_elements': (64, 'Elements (unused with an accuracy).', 2, 2_000),
    'simulator.n_terms': (10, 'Terms of the series (unused by local and with an '
                              'accuracy).', 1, 200),
    'simulator.self_contact': (False, 'Whether strands of the DLO keep each other off in predicted '
                                      'shapes, of a round and elastic one; plans and estimates '
                                      'refuse it.'),
    'simulator.self_friction': (0.0, 'Coefficient of friction between strands, with '
                                     'simulator.self_contact.', 0.0, 10.0),
    'simulator.accuracy': (0.0, 'Wanted accuracy, m, 1e-6 of the length at least; 0 = use '
                                'n_elements and n_terms.', 0.0, 1.0),
    'tool.position': ([0.0, 0.0, 0.0], 'Where the DLO leaves the gripper, in the tool frame that '
                                       'gripper poses refer to, m.'),
    'tool.orientation': ([0.0, 0.0, 0.0, 1.0], "Quaternion x, y, z, w there; its x axis is the "
                                               "DLO's tangent."),
    'tool.frame_id': ('tool0', 'Name of the tool frame, in which gripper_wrench is given.'),
    'far_end.hold': ('free', 'How a second grip at far_end_pose holds the far end: free (not at '
                             'all) | pinned | clamped | sleeve | aligned.'),
    'far_end.timeout': (0.5, 'Age of the last far_end_pose, by its stamp, from which on the far '
                             'end counts as free, s; 0 = any.', 0.0, 60.0),
    'far_end.frame_id': ('far_end', 'Name of the frame of far_end_pose, in which far_end_wrench is '
                                    'given.'),
    'task': ('{type: Thread}', 'The task, YAML or JSON as Task.to_dict writes it; its pose, depths '
                               'and radii may be left out. A message on task counts in its place.'),
    'threading.waypoints': (40, 'Poses in a plan.', 2, 10_000),
    'threading.deepest': (0.95, 'Part of the length that is threaded through.', 0.0, 1.0),
    'threading.linear_speed': (0.1, 'Limit of the motion, m/s.', 0.0001, 10.0),
    'threading.angular_speed': (0.5, 'Limit of the motion, rad/s.', 0.0001, 100.0),
    'threading.linear_acceleration': (0.5, 'Limit of the motion, m/s^2.', 0.0001, 1000.0),
    'threading.angular_acceleration': (2.0, 'Limit of the motion, rad/s^2.', 0.0001, 10000.0),
    'threading.linear_jerk': (5.0, 'Limit of the motion, m/s^3.', 0.0001, 100000.0),
    'threading.angular_jerk': (20.0, 'Limit of the motion, rad/s^3.', 0.0001, 1e6),
    'threading.standoff': (0.0, "Unless it is 0, a plan begins at the gripper's present pose, and "
                                "the free end waits so far before the hole, or what touches so "
                                "far above its contact, m; below 0 = of 0.05, 0.1, 0.15 of the "
                                "length what makes the calm motion the quickest, 0.05 above a "
                                "contact.", -1.0, 10.0),
    'threading.gripper_clearance': (0.0, 'The plan ends where the gripper comes nearer to the '
                                         'sheet than this, m; 0 = does not care.', 0.0, 10.0),
    'threading.max_misalignment': (-1.0, 'Largest angle of the DLO against the normal of one hole '
                                         'that has a size, rad; 0 = along the normal, or no plan; '
                                         'below 0 = as oblique as leaves the most margin.', -1.0,
                                   1.5707),
    'threading.margin': (0.0, 'Least margin in a hole: the clearance less two standard deviations '
                              'of the miss that is to be expected, m; 0 = any.', 0.0, 10.0),
    # no range: it would refuse nan
    'threading.tolerance': (0.0, 'By how much the DLO in motion may miss, come nearer to a rim '
                                 'than planned, or still vibrate at the end, m; 0 or nan = a '
                                 'quarter of the room in the hole, 0.001 where it has no size.'),
    'threading.deadline': (60.0, 'Computing after which the search for a motion that leaves the '
                                 'DLO at rest is given up, s.', 0.1, 3600.0),
    'threading.planning_deadline': (60.0, 'Computing after which the search for a plan is given '
                                          'up, s.', 0.01, 3600.0),
    'threading.may_yield': (True, 'Whether a plan may set the DLO for good.'),
    'cutouts.radius': (0.0, 'Of round cut-outs and bores that do not say theirs, m; 0 = not '
                            'known.', 0.0, 10.0),
    'contacts.tolerance': (0.0, 'By how much the DLO may miss the place that it is to touch, '
                                'across it, m; 0 = not stated: what touches is executed in open '
                                'loop.', 0.0, 10.0),
    'scene.file': ('', 'File of what stands in the cell: .scene of MoveIt, .xml (MJCF), .urdf, '
                       '.stl .obj .ply .glb .3mf, or .yaml, a list of obstacles that may name '
                       'files with unit and pose; empty = none. Read when it is set.'),
    'obstacles.friction': (0.0, "Coulomb's coefficient of obstacles that do not say "
                                "theirs.", 0.0, 10.0),
    'workspace.lower': ([-_ANY] * 3, 'Corner of the box for the gripper, m.'),
    'workspace.upper': ([_ANY] * 3, 'The other corner, m.'),
    'workspace.gripper_radius': (0.0, 'Of the sphere about the gripper that keeps out of obstacles '
                                      'and in the box, m.', 0.0, 10.0),
    'workspace.reach': (1000.0, 'Farthest from the origin of frame_id that any pose may be, '
                                'm.', 0.001, 1e6),
    'spread.bending_stiffness': (0.05, 'How uncertain EI is: standard deviation as a part of '
                                       'it.', 0.0, 1.0),
    'spread.torsional_stiffness': (0.05, 'The same of GJ.', 0.0, 1.0),
    'spread.mass': (0.02, 'The same of all masses.', 0.0, 1.0),
    'spread.mass_gradient': (0.02, 'The same of how much the mass per length grows along the DLO, '
                                   'as a part of its mean.', 0.0, 1.0),
    'spread.length': (0.0, 'The same of the length, m.', 0.0, 1.0),
    'spread.natural_curvature': (-1.0, 'The same of each component of the natural curvature, 1/m; '
                                       'below 0 = by the DLO: 0.05 rad over its length, and a '
                                       'fifth of what is stated.', -1.0, 10000.0),
    'spread.curvature_variation': (-1.0, 'The same of what varies along s of it, 1/m; below 0 = '
                                         'by the DLO: 0.03 rad over its length.', -1.0, 10000.0),
    'spread.gripper_position': (0.0005, 'The same of where the gripper holds the DLO along each '
                                        'axis, m.', 0.0, 1.0),
    'spread.gripper_rotation': (0.0035, 'The same of how it is turned about each axis, '
                                        'rad.', 0.0, 3.2),
    'observe.noise': (0.001, 'Standard deviation of each coordinate of observed_points, '
                             'm.', 1e-6, 1.0),
    'observe.bias': (0.001, "Of the camera's constant error along each axis, m: what is left of "
                             'its calibration. It cancels where the camera sees the cut-out as '
                             'well.', 0.0, 1.0),
    'observe.camera_rotation': (0.0005, 'The same about each axis, rad.', 0.0, 0.5),
    'observe.outliers': (0.1, 'Part of the points that are none of the DLO.', 0.0, 0.9),
    'observe.sway': (0.0005, 'Of the free end about its rest while the gripper stands still, '
                             'm.', 0.0, 1.0),
    'observe.cutout': (0.0, 'Of the place of a cut-out along each axis, m.', 0.0, 1.0),
    'observe.stamps': (0.05, 'By how much the stamps of clouds may be wrong against those of '
                             'gripper_pose, s.', 0.0, 1.0),
    'observe.robot_position': (0.0002, "Standard deviation of the robot's error along each axis, "
                                       "m: where it is less where it measures, by its "
                                       "pose.", 0.0, 1.0),
    'observe.robot_rotation': (0.0003, 'The same about each axis, rad.', 0.0, 3.2),
    'observe.robot_way': (0.4, 'Way of the gripper in which that error changes, m; a turn counts '
                               'by 0.25 m.', 0.001, 10000.0),
    'observe.robot_time': (0.0, 'Time in which that error changes, s; 0: it depends on the pose '
                                'alone.', 0.0, 10000.0),
    'observe.slip_position': (0.005, 'Standard deviation of how far the DLO slips in the gripper '
                                     'along each axis where observations become '
                                     'inconsistent, m.', 0.0, 1.0),
    'observe.slip_rotation': (0.05, 'The same about each axis, rad.', 0.0, 3.2),
    'observe.kink': (0.1, 'By how much it may be bent for good then, about each axis of its '
                          'section, at any one place, rad.', 0.0, 3.2),
    'observe.period': (0.2, 'Seconds between two clouds that are used.', 0.0, 60.0),
    'observe.pose_holds': (1.0, 'Seconds for which the last gripper_pose holds for clouds that are '
                                'newer, where the gripper stands (the last two poses are the same, '
                                'or there is but one).', 0.0, 60.0),
    'observe.correct': (True, 'Whether what is seen counts for what is executed: by a closed '
                              'loop, or by a stop before a cut-out that the DLO may miss.'),
    'observe.correction_period': (0.5, 'Seconds between two corrections.', 0.0, 60.0),
    'observe.largest_correction': (0.02, 'A correction that moves the gripper farther is not '
                                         'executed, m.', 0.0, 10.0),
    'arm.tool_link': ('', 'Link of robot_description whose frame is the tool frame; empty: no '
                          'joint trajectories are made.'),
    'arm.joints': ([''], 'Joints that move; none: all that move the tool link.'),
    'arm.packages': ([''], 'Folders with the packages of meshes (package://), besides those of '
                           'AMENT_PREFIX_PATH.'),
    'arm.base.position': ([0.0, 0.0, 0.0], 'Where the root link of robot_description is in '
                                           'frame_id, m.'),
    'arm.base.orientation': ([0.0, 0.0, 0.0, 1.0], 'Quaternion x, y, z, w of it.'),
    'arm.self_clearance': (0.005, 'By how much links have to stay clear of each other, m.'),
    'arm.deadline': (20.0, 'Computing after which the search is given up, s.'),
    'autostart': (True, 'Whether the node configures and activates itself, without a lifecycle '
                        'manager.'),
    'markers.color': ('curvature', 'What the color of the DLO tells: curvature | yield | tension.'),
    'execute.through': ('ahead', 'How the robot is told what is executed: pose (gripper_command) | '
                                 'ahead (gripper_commands_ahead, and gripper_command beside it) | '
                                 'joints (joint_commands_ahead, of the arm of arm.tool_link, which '
                                 'joint_states are the gripper of).'),
    'execute.rate': (50.0, 'Commands per second on gripper_command.', 1.0, 1000.0),
    'execute.horizon': (1.0, 'Seconds of the coming motion that are sent to the robot in advance, '
                             'by gripper_commands_ahead or joint_commands_ahead; 0, or with '
                             'execute.through = pose: none, the motion goes on with each '
                             'gripper_command.', 0.0, 10.0),
    'execute.start_distance': (0.02, "How far from a plan's beginning the gripper may be to "
                                     "execute it, m.", 0.0, 10.0),
    'execute.start_angle': (0.1, 'How far it may be turned against that, rad.', 0.0, 3.2),
    'execute.longest_pause': (0.5, 'Seconds between two commands after which an execution ends: '
                                   'the rest is not the motion that was proved; 0 = '
                                   'any.', 0.0, 60.0),
    'execute.enable_timeout': (0.0, 'Age of the last true on ~/enable (a deadman switch), from '
                                    'which on an execution is refused or stops, s; 0 = none is '
                                    'asked for.', 0.0, 60.0),
    # Named and meant as those of joint_trajectory_controller and moveit_servo: 0 = not checked.
    'constraints.path.position': (0.02, 'Farthest that the gripper may be from its command on the '
                                        'way; more than speed times lag, m; 0 = any.', 0.0, 10.0),
    'constraints.path.angle': (0.1, 'How far it may be turned against that, rad; 0 = '
                                    'any.', 0.0, 3.2),
    'constraints.path.shape': (0.05, 'Farthest that the observed DLO may be from its plan, m; 0 = '
                                     'any.', 0.0, 10.0),
    'constraints.goal.position': (0.01, 'Farthest that the gripper may be from the last command at '
                                        'the end, m; 0 = any.', 0.0, 10.0),
    'constraints.goal.angle': (0.05, 'How far it may be turned against that, rad; 0 = '
                                     'any.', 0.0, 3.2),
    'constraints.goal_time': (2.0, 'Seconds after the end of the motion in which the gripper has '
                                   'to come there; 0 = waits for good.', 0.0, 3600.0),
    'constraints.pull_time': (0.1, 'Seconds for which the gripper may pull, by ~/measured_wrench, '
                                   'so much harder than planned that a fitting may be overloaded: '
                                   'a DLO that swings pulls for less; 0 = neither that nor a '
                                   'sensor that falls silent is watched.',
                              0.0, 60.0),
    'cmd_timeout': (0.0, 'Seconds after the end of the motion for which the last command is '
                         'repeated, where constraints.goal_time is 0; 0 = for good.', 0.0, 3600.0),
    'incoming_command_timeout': (0.1, 'Age of the last gripper_pose, by its stamp, from which on '
                                      'an execution is refused or stops, and of measured_wrench, '
                                      'by its arrival, from which on it stops, s; 0 = any.',
                                 0.0, 60.0),
    'decelerate_on_cancel': (True, 'Whether `cancel` lets the motion run out within the limits of '
                                   'acceleration, or ends it with the last command.'),
}


def _spec(name: str, default: Any, description: str, *limits: float) -> ParameterSpec:
    lowest, highest = limits or (None, None)
    return ParameterSpec(default, description, lowest, highest, name in _READ_ONLY,
                         name in _WHILE_EXECUTING)


PARAMETERS = {name: _spec(name, *row) for name, row in _TABLE.items()}


def as_declared(name: str, value: Any, default: Any) -> Any:
    """Return a value with whole numbers made floats where `default` has floats."""
    listed = not isinstance(value, str | dict) and hasattr(value, '__iter__')
    if isinstance(default, list) and isinstance(default[0], str):
        if not listed or any(not isinstance(item, str) for item in value):
            raise InvalidTask(f'parameter {name} = {shown(value)}: expected a list of strings')
        return list(value) or default
    if isinstance(default, list):
        if not listed or not all(map(_is_number, value)):
            raise InvalidTask(f'parameter {name} = {shown(value)}: expected a list of numbers')
        return [_float(name, item) for item in value]
    if isinstance(default, float) and _is_number(value):
        return _float(name, value)
    if type(value) is not type(default):
        raise InvalidTask(f'parameter {name} = {shown(value)}: expected a {type(default).__name__}')
    return value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _float(name: str, value: Any) -> float:
    try:
        return float(value)
    except OverflowError:
        raise InvalidTask(f'parameter {name}: expected a number below 1e308') from None


def within_limits(name: str, value: Any, entry: ParameterSpec) -> Any:
    """Return a value of the right type; raise InvalidTask if it is beyond the limits."""
    if entry.lowest is not None and not entry.lowest <= value <= entry.highest:
        raise InvalidTask(f'parameter {name} = {shown(value)}: expected {entry.lowest:g} to '
                          f'{entry.highest:g} {entry.unit}'.rstrip())
    return value


def unknown_parameter(name: str, known: Iterable[str]) -> str:
    """Return the warning about a value for a parameter that does not exist."""
    by_lower = {one.lower(): one for one in known}
    ends = {one.rsplit('.', 1)[-1]: one for one in by_lower}
    given = name.lower()
    near = get_close_matches(given, by_lower, 1) or [
        ends[end] for end in get_close_matches(given.rsplit('.', 1)[-1], ends, 1)]
    hint = f': did you mean {by_lower[near[0]]}?' if near else ''
    return f'parameter {name} does not exist, its value has no effect{hint}'
