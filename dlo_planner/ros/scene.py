"""What the node works on, made of the values of its parameters and the obstacles around."""

from dataclasses import dataclass, fields
from functools import cached_property
from math import isnan

import numpy as np

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.limits import Limits
from dlo_planner.inverse.robustness import Spread
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.workspace import Workspace
from dlo_planner.model.along import Expanded
from dlo_planner.model.checks import choice, vector
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.ros.execution import Guards
from dlo_planner.ros.observing import Seeing
from dlo_planner.view.colors import COLORINGS

SECTIONS = ('round', 'tube', 'rectangular', 'stiffness')
_MOST_TOLERANCE = 1.0  # m
_MOST_GRAVITY = 1e4    # m/s^2
_FINEST = 1e-6         # accuracy, of the length: a shape takes less than a second


@dataclass(frozen=True)
class Scene:
    """What the node works on; replaced as a whole when a parameter or an obstacle changes."""

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
    planning_deadline: float
    reach: float
    period: float
    guards: Guards
    seeing: Seeing
    color: str

    @cached_property
    def solid(self) -> Workspace:
        """Return what nothing can be inside of."""
        return Workspace(keep_out=self.direct.obstacles)

    def keeps_shapes(self, other: 'Scene') -> bool:
        """Whether a DLO hangs in another Scene as it does in this one."""
        return self.direct == other.direct

    def keeps_plans(self, other: 'Scene') -> bool:
        """Whether what was planned and proved in this Scene holds in another one."""
        return all(getattr(self, name) == getattr(other, name) for name in (
            'frame_id', 'direct', 'inverse', 'tool', 'limits', 'cutout_radius'))


def build_scene(values, obstacles=()):
    """Return the Scene of parameter values.

    Args:
        values: dict of all names in ENTRIES -> value
        obstacles: for the DLO and for the gripper

    Raises:
        DloPlannerError: a value, or their combination, makes no sense
    """
    rod = _rod(values)
    _judge(values)
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
                 values['execute.start_distance'], values['execute.start_angle'],
                 values['threading.planning_deadline'], values['workspace.reach'],
                 1 / values['execute.rate'], _guards(values), _seeing(values),
                 values['markers.color'])


def _judge(values):
    """Refuse sizes that no DLO in a cell has; what else makes no sense the library refuses."""
    choice('parameter markers.color', values['markers.color'], COLORINGS)
    accuracy, reach = values['simulator.accuracy'], values['workspace.reach']
    finest = _FINEST * values['rod.length']
    if 0 < accuracy < finest:
        raise InvalidTask(f'parameter simulator.accuracy = {accuracy:g}: expected at least '
                          f'{finest:g} m, 1e-6 of the length; 0 for n_elements and n_terms')
    for name, most, unit in (('tool.position', reach, 'm'),
                             ('gravity', _MOST_GRAVITY, 'm/s^2')):
        if not np.linalg.norm(np.nan_to_num(values[name], nan=0.0)) <= most:
            raise InvalidTask(f'parameter {name} = {list(values[name])}: expected a length of at '
                              f'most {most:g} {unit}')


def _guards(values):
    path, goal = 'constraints.path.', 'constraints.goal.'
    return Guards(values[path + 'position'], values[path + 'angle'], values[path + 'shape'],
                  values[goal + 'position'], values[goal + 'angle'],
                  values['constraints.goal_time'], values['cmd_timeout'],
                  values['incoming_command_timeout'], values['decelerate_on_cancel'],
                  values['execute.longest_pause'])


def _seeing(values):
    spread = Spread(**{item.name: values[f'spread.{item.name}'] for item in fields(Spread)})
    return Seeing(spread, **{item.name: values[f'observe.{item.name}'] for item in fields(Seeing)
                             if item.name != 'spread'})


def _rod(values):
    section = values['rod.section']
    if len(values['rod.damping']) != 2:
        raise InvalidTask(f'parameter rod.damping = {values["rod.damping"]}: expected two numbers, '
                          '1/s times mass and s times stiffness')
    more = {name: values[f'rod.{name}'] for name in (
        'natural_twist', 'tip_mass', 'damping', 'hardening')}
    more['natural_curvature'] = _natural_curvature(values)
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


def _natural_curvature(values):
    """Return the pair, or the function of s where it varies."""
    even, terms = values['rod.natural_curvature'], values['rod.natural_curvature_terms']
    if len(terms) % 2 or not np.isfinite(terms).all():
        raise InvalidTask(f'parameter rod.natural_curvature_terms = {terms!r}: expected pairs of '
                          'finite numbers')
    if not any(terms):
        return even
    rows = np.vstack([np.zeros(2), np.reshape(terms, (-1, 2))])
    return Expanded(tuple(vector('rod.natural_curvature', even, 2)), rows, values['rod.length'])


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
