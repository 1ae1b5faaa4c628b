"""The node's parameters: one table of them, and the immutable scene they describe."""

from dataclasses import dataclass, fields
from math import isnan

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.limits import Limits
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.workspace import Workspace
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.ros.overrides import take_overrides, unknown_override

SECTIONS = ('round', 'tube', 'rectangular', 'stiffness')
_MOST_TOLERANCE = 1.0  # m


@dataclass(frozen=True)
class Entry:
    """One parameter: its default (which fixes the type), meaning, limits, and if it may change."""

    default: object
    description: str
    lowest: float | None = None
    highest: float | None = None
    read_only: bool = False

    def descriptor(self):
        """Return the rcl_interfaces/ParameterDescriptor."""
        descriptor = ParameterDescriptor(description=self.description, read_only=self.read_only)
        if self.lowest is not None and isinstance(self.default, float):
            descriptor.floating_point_range = [FloatingPointRange(
                from_value=float(self.lowest), to_value=float(self.highest), step=0.0)]
        elif self.lowest is not None:
            descriptor.integer_range = [IntegerRange(
                from_value=int(self.lowest), to_value=int(self.highest), step=1)]
        return descriptor


ENTRIES = {
    'frame_id': Entry('world', 'Frame of all poses in and out, z up.', read_only=True),
    'diagnostics_period': Entry(1.0, 'Seconds between messages on /diagnostics.', 0.05, 60.0,
                                read_only=True),
    'rod.name': Entry('copper wire', 'Name of the DLO, in the log and on diagnostics.'),
    'rod.section': Entry('round', 'Section: round | tube | rectangular (density, youngs_modulus, '
                         'poisson_ratio and sizes are used) | stiffness (mass_per_length, '
                         'bending_stiffness, torsional_stiffness are used).'),
    'rod.length': Entry(1.0, 'Length between gripper and free end, m.', 1e-3, 100.0),
    'rod.diameter': Entry(1e-3, 'Outer diameter (round, tube; elsewhere for pictures), m.',
                          1e-5, 1.0),
    'rod.inner_diameter': Entry(0.0, 'Inner diameter of a tube, m.', 0.0, 1.0),
    'rod.width': Entry(0.01, 'Width along the n axis (rectangular), m.', 1e-5, 1.0),
    'rod.thickness': Entry(0.001, 'Thickness along the b axis (rectangular), m.', 1e-5, 1.0),
    'rod.density': Entry(8960.0, 'Density, kg/m^3.', 0.0, 3e4),
    'rod.youngs_modulus': Entry(110e9, 'Young\'s modulus, Pa.', 1e3, 1e13),
    'rod.poisson_ratio': Entry(0.34, 'Poisson ratio.', -0.99, 0.5),
    'rod.mass_per_length': Entry(0.007, 'Mass per length (section: stiffness), kg/m.', 0.0, 1e3),
    'rod.bending_stiffness': Entry([0.0054, 0.0054], 'EI_n, EI_b (section: stiffness), N m^2.'),
    'rod.torsional_stiffness': Entry(0.004, 'GJ (section: stiffness), N m^2.', 1e-12, 1e9),
    'rod.natural_curvature': Entry([0.0, 0.0], 'Stress-free curvature k_n, k_b, 1/m.'),
    'rod.natural_twist': Entry(0.0, 'Stress-free torsion, 1/m.', -1e4, 1e4),
    'rod.tip_mass': Entry(0.0, 'Mass at the free end, kg.', 0.0, 1e3),
    'rod.damping': Entry([0.0, 0.0], 'Rayleigh damping in motion: 1/s times mass, s times '
                         'stiffness.'),
    'rod.yield_stress': Entry(0.0, 'Stress at which it yields (sections), Pa; 0 = never.', 0.0,
                              1e12),
    'rod.yield_curvature': Entry([0.0, 0.0], 'Curvatures about n and b at which it yields '
                                 '(section: stiffness), 1/m; 0 = never.'),
    'rod.yield_torsion': Entry(0.0, 'Torsion at which it yields (section: stiffness), 1/m; 0 = '
                               'never.', 0.0, 1e6),
    'rod.section_model': Entry('', 'How it goes on yielding: fibres | round | rectangular | '
                               'ideal; empty: fibres of a section, ideal without.'),
    'rod.hardening': Entry(0.0, 'Part of the stiffness that never yields.', 0.0, 0.999),
    'rod.max_bend_curvature': Entry(0.0, 'Curvature that no plan may exceed, 1/m; 0 = any.', 0.0,
                                    1e6),
    'gravity': Entry([0.0, 0.0, -9.81], 'Gravity in the world frame, m/s^2.'),
    'simulator.basis': Entry('chebyshev', 'How a shape is written: chebyshev | fourier | local.'),
    'simulator.n_elements': Entry(64, 'Elements (unused with an accuracy).', 2, 100_000),
    'simulator.n_terms': Entry(10, 'Terms of the series (unused by local and with an accuracy).',
                               1, 200),
    'simulator.accuracy': Entry(0.0, 'Wanted accuracy, m; 0 = use n_elements and n_terms.',
                                0.0, 1.0),
    'tool.position': Entry([0.0, 0.0, 0.0], 'Where the DLO leaves the gripper, in the tool frame '
                           'that gripper poses refer to, m.'),
    'tool.orientation': Entry([0.0, 0.0, 0.0, 1.0], 'Quaternion x, y, z, w there; its x axis is '
                              'the DLO\'s tangent.'),
    'threading.waypoints': Entry(40, 'Poses in a plan.', 2, 10_000),
    'threading.deepest': Entry(0.95, 'Part of the length that is threaded through.', 0.0, 1.0),
    'threading.linear_speed': Entry(0.1, 'Limit of the motion, m/s.', 1e-4, 10.0),
    'threading.angular_speed': Entry(0.5, 'Limit of the motion, rad/s.', 1e-4, 100.0),
    'threading.linear_acceleration': Entry(0.5, 'Limit of the motion, m/s^2.', 1e-4, 1e3),
    'threading.angular_acceleration': Entry(2.0, 'Limit of the motion, rad/s^2.', 1e-4, 1e4),
    'threading.linear_jerk': Entry(5.0, 'Limit of the motion, m/s^3.', 1e-4, 1e5),
    'threading.angular_jerk': Entry(20.0, 'Limit of the motion, rad/s^3.', 1e-4, 1e6),
    'threading.standoff': Entry(0.0, 'With more than 0, a plan begins at the gripper\'s present '
                                'pose, and the free end waits so far before the hole, m.', 0.0,
                                10.0),
    'threading.gripper_clearance': Entry(0.0, 'The plan ends where the gripper comes nearer to '
                                         'the sheet than this, m; 0 = does not care.', 0.0, 10.0),
    # No range: it would refuse nan.
    'threading.tolerance': Entry(0.0, 'By how much the DLO in motion may miss, come nearer to a '
                                 'rim than planned, or still vibrate at the end, m; 0 or nan = a '
                                 'quarter of the room in the hole, 0.001 where it has no size.'),
    'threading.deadline': Entry(60.0, 'Computing after which the search for a calm motion is given '
                                'up, s.', 0.1, 3600.0),
    'threading.may_yield': Entry(True, 'Whether a plan may set the DLO for good.'),
    'cutouts.radius': Entry(0.0, 'Of round cut-outs, for clearances, m; 0 = not known.', 0.0,
                            10.0),
    'workspace.lower': Entry([-float('inf')] * 3, 'Corner of the box for the gripper, m.'),
    'workspace.upper': Entry([float('inf')] * 3, 'The other corner, m.'),
    'workspace.gripper_radius': Entry(0.0, 'Of the sphere about the gripper that keeps out of '
                                      'obstacles and in the box, m.', 0.0, 10.0),
    'execute.rate': Entry(50.0, 'Commands per second on gripper_command.', 1.0, 1000.0,
                          read_only=True),
    'execute.start_distance': Entry(0.02, 'How far from a plan\'s beginning the gripper may be to '
                                    'execute it, m.', 0.0, 10.0),
    'execute.start_angle': Entry(0.1, 'How far it may be turned against that, rad.', 0.0, 3.2),
}


@dataclass(frozen=True)
class Scene:
    """What the node works on; replaced as a whole when a parameter changes."""

    frame_id: str
    name: str
    direct: DirectSimulator
    inverse: InverseSimulator
    tool: Pose
    waypoints: int
    deepest: float
    linear_speed: float
    angular_speed: float
    limits: Limits
    standoff: float
    gripper_clearance: float
    tolerance: float | None
    deadline: float
    cutout_radius: float | None
    start_distance: float
    start_angle: float


def declare(node):
    """Declare all parameters with the values given at the start; warn of those that do not exist.

    Whole numbers in YAML are taken for doubles where doubles are due.

    Args:
        node: made with `automatically_declare_parameters_from_overrides=True`
    """
    given = take_overrides(node)
    for name, entry in ENTRIES.items():
        value = _as_declared(name, given.pop(name, entry.default), entry.default)
        node.declare_parameter(name, value, entry.descriptor(), ignore_override=True)
    for name in given:
        node.get_logger().warning(unknown_override(name, ENTRIES))


def _as_declared(name, value, default):
    """Return `value` with whole numbers made floats where `default` has floats."""
    def number(item):
        return isinstance(item, int | float) and not isinstance(item, bool)

    if isinstance(default, float) and number(value):
        return float(value)
    if isinstance(default, list):
        items = list(value) if not isinstance(value, str) and hasattr(value, '__iter__') else None
        if items is None or not all(number(item) for item in items):
            raise InvalidTask(f'parameter {name} = {value!r}: expected a list of numbers')
        return [float(item) for item in items]
    if type(value) is not type(default):
        raise InvalidTask(f'parameter {name} = {value!r}: expected a {type(default).__name__}')
    return value


def build_scene(values, obstacles=()):
    """Return the Scene of parameter values.

    Args:
        values: dict of all names in ENTRIES -> value
        obstacles: for the DLO and for the gripper

    Raises:
        DloPlannerError: a value, or their combination, makes no sense
    """
    rod = _rod(values)
    options = {'accuracy': values['simulator.accuracy']}
    if not options['accuracy']:
        options = {'n_elements': values['simulator.n_elements']}
        if values['simulator.basis'] != 'local':
            options['n_terms'] = values['simulator.n_terms']
    direct = DirectSimulator(rod, basis=values['simulator.basis'], gravity=values['gravity'],
                             obstacles=obstacles, **options)
    workspace = Workspace(values['workspace.lower'], values['workspace.upper'], obstacles,
                          values['workspace.gripper_radius'])
    inverse = InverseSimulator(direct, workspace=workspace,
                               may_yield=values['threading.may_yield'])
    return Scene(values['frame_id'], values['rod.name'], direct, inverse,
                 Pose(values['tool.position'], values['tool.orientation']),
                 values['threading.waypoints'], values['threading.deepest'],
                 values['threading.linear_speed'], values['threading.angular_speed'],
                 Limits(**{item.name: values[f'threading.{item.name}'] for item in fields(Limits)}),
                 values['threading.standoff'], values['threading.gripper_clearance'],
                 _tolerance(values['threading.tolerance']), values['threading.deadline'],
                 values['cutouts.radius'] or None,
                 values['execute.start_distance'], values['execute.start_angle'])


def _rod(values):
    section = values['rod.section']
    more = {name: values[f'rod.{name}'] for name in (
        'natural_curvature', 'natural_twist', 'tip_mass', 'damping', 'hardening')}
    more['section_model'] = values['rod.section_model'] or None
    more['max_bend_curvature'] = values['rod.max_bend_curvature'] or None
    stress = {'yield_stress': values['rod.yield_stress'] or None}
    material = [values[f'rod.{name}'] for name in ('density', 'youngs_modulus', 'poisson_ratio')]
    length, diameter = values['rod.length'], values['rod.diameter']
    if section == 'round':
        return Rod.circular(length, diameter, *material, **stress, **more)
    if section == 'tube':
        return Rod.tube(length, diameter, values['rod.inner_diameter'], *material, **stress, **more)
    if section == 'rectangular':
        return Rod.rectangular(length, values['rod.width'], values['rod.thickness'], *material,
                               **stress, **more)
    if section == 'stiffness':
        return Rod(length, values['rod.mass_per_length'], tuple(values['rod.bending_stiffness']),
                   values['rod.torsional_stiffness'], radius=diameter / 2,
                   yield_curvature=_limits(values['rod.yield_curvature']),
                   yield_torsion=values['rod.yield_torsion'] or None, **more)
    raise InvalidTask(f'parameter rod.section = {section!r}: expected one of '
                      f'{", ".join(SECTIONS)}')


def _tolerance(value):
    """Return the tolerance in m; None, which means the default, for 0 and nan."""
    if isnan(value) or value == 0:
        return None
    if not 0 < value <= _MOST_TOLERANCE:
        raise InvalidTask(f'parameter threading.tolerance = {value!r}: expected more than 0 and at '
                          f'most {_MOST_TOLERANCE:g} m; 0 or nan for the default')
    return value


def _limits(curvatures):
    """Return the pair for `Rod.yield_curvature`; None if both are 0, which means never."""
    return tuple(value or 1e12 for value in curvatures) if any(curvatures) else None
