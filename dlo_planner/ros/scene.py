# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the node works on, made of the values of its parameters and the obstacles around."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from dlo_planner.direct.grasp import GraspedInside
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import DloPlannerError, InvalidTask
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.guards import Guards
from dlo_planner.identify.estimator import EstimatorConfig
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.model.checks import choice
from dlo_planner.model.holds import GRIPS
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.plan.requirements import Limits
from dlo_planner.plan.workspace import Workspace
from dlo_planner.scene import Scene as CellScene
from dlo_planner.settings.build import (
    bounded,
    direct_of,
    grasped_of,
    inverse_of,
    limits_of,
    spread_of,
    tolerance_of,
)
from dlo_planner.settings.tasks import open_task
from dlo_planner.view.colors import COLORINGS
from msg_helpers.obstacles import Body

THROUGH = ('pose', 'ahead', 'joints')  # how a robot is told what is executed
_MOTION = 0.95    # of the limits, which a motion is made for: the rest is left to corrections
_LONGEST = 1000   # characters or entries of a value
_LONGEST_GROUP = 200  # characters of a namespace in the name of an obstacle
_OPEN = lru_cache(4)(open_task)  # a long text takes long to read, at each change of an obstacle


@dataclass(frozen=True)
class Scene:
    """What the node works on, made of its parameters and obstacles; replaced as a whole.

    `scene[name]` is the value of a parameter.
    """

    values: Mapping[str, Any]
    standing: CellScene  # what the file of the cell says, before the bodies
    bodies: Mapping[tuple[str, int], Body]  # obstacles by namespace and id
    direct: DirectSimulator
    inverse: InverseSimulator
    grasped: GraspedInside | None
    tool: Pose
    task: Mapping[str, Any]
    limits: Limits           # of all motions
    tolerance: float | None  # of a motion, m; None: the default
    guards: Guards
    seeing: EstimatorConfig

    @classmethod
    def of(cls, values: Mapping[str, Any],
           bodies: Mapping[tuple[str, int], Body] = MappingProxyType({})) -> 'Scene':
        """Return the Scene of parameter values and obstacles."""
        _judge(values)
        standing = _standing(values['scene.file'], values['obstacles.friction'])
        solids: dict[str, list[Obstacle]] = {
            'all': list(standing.obstacles), 'workspace only': []}
        for key, body in bodies.items():
            friction = values['obstacles.friction'] if body.friction is None else body.friction
            solids[body.role].append(replace(body.obstacle, friction=friction,
                                             name=body_name(key)))
        direct = direct_of(values, solids['all'])
        planned = direct_of({**values, 'simulator.self_contact': False,
                             'simulator.self_friction': 0.0}, solids['all'])
        return cls(values, standing, bodies, direct,
                   inverse_of(values, planned, solids['workspace only']),
                   grasped_of(values, direct),
                   Pose(values['tool.position'], values['tool.orientation']),
                   _OPEN(values['task'], 'parameter task'), limits_of(values),
                   tolerance_of(values), _guards(values), _seeing(values))

    def __getitem__(self, name: str) -> Any:
        return self.values[name]

    @property
    def observed(self) -> DirectSimulator:
        """The simulator of what is estimated: of the part in front where it is grasped inside."""
        return self.direct if self.grasped is None else self.grasped.parts[1]

    def refuse_self_contact(self, what: str) -> None:
        """Raise Refused where strands keep each other off, of which `what` knows nothing."""
        if self['simulator.self_contact']:
            raise Refused(Cause.INVALID_PARAMETER, 'parameter simulator.self_contact = True: '
                          f'expected False for {what}, which knows of no contact of the DLO with '
                          'itself')

    @property
    def frame_id(self) -> str:
        """Frame of all that goes out."""
        return str(self['frame_id'])

    @property
    def reach(self) -> float:
        """How far from the origin anything may be, m."""
        return float(self['workspace.reach'])

    @property
    def period(self) -> float:
        """Seconds between two commands."""
        return 1 / float(self['execute.rate'])

    @property
    def by_joints(self) -> bool:
        """Whether the joints of an arm are told what is executed, and say where the gripper is."""
        return bool(self['execute.through'] == 'joints')

    @property
    def horizon(self) -> float:
        """Seconds of the coming motion that a robot is told; 0: single commands."""
        return 0.0 if self['execute.through'] == 'pose' else float(self['execute.horizon'])

    @property
    def cutout_radius(self) -> float | None:
        """Radius of cut-outs that state none, m; None: not known."""
        return self['cutouts.radius'] or None

    @cached_property
    def solid(self) -> Workspace:
        """Return what nothing can be inside of."""
        return Workspace(keep_out=self.direct.obstacles)

    @property
    def workspace(self) -> Workspace:
        """Where the gripper may be; in the node there always is one."""
        assert self.inverse.workspace is not None
        return self.inverse.workspace

    @property
    def motion_limits(self) -> Limits:
        """Limits that a plan's motion is made for: what corrects it may use the rest."""
        return Limits(*map(float, (_MOTION * self.limits.sizes).ravel()))

    def keeps_plans(self, other: 'Scene') -> bool:
        """Whether what was planned and proved in this Scene holds in another one."""
        return all(getattr(self, name) == getattr(other, name) for name in (
            'frame_id', 'direct', 'grasped', 'inverse', 'tool', 'limits', 'cutout_radius'))


@lru_cache(1)  # the last one: parameters and obstacles change more often than the file does
def _standing(path: str, friction: float) -> CellScene:
    """Return what the file of the cell says; nothing without one."""
    if not path:
        return CellScene()
    try:
        return CellScene.read(path, friction=friction)
    except DloPlannerError as error:
        raise InvalidTask(f'parameter scene.file: {error}') from None


def body_name(key: tuple[str, int]) -> str:
    """Return how an obstacle is called, of its (namespace, id), as in RViz."""
    group = ''.join(sign if sign.isprintable() else '?' for sign in key[0][:_LONGEST_GROUP])
    return f'{group.strip()}/{key[1]}' if group.strip() else f'marker {key[1]}'


def _judge(values: Mapping[str, Any]) -> None:
    """Refuse what makes no sense to the node alone, and what is too long to be said."""
    for name, value in values.items():
        if name != 'task' and isinstance(value, str | list) and len(value) > _LONGEST:
            raise InvalidTask(f'parameter {name} has {len(value)} characters or entries: expected '
                              f'{_LONGEST} at most')
    choice('parameter markers.color', values['markers.color'], COLORINGS)
    if choice('parameter execute.through', values['execute.through'], THROUGH) == 'joints':
        if not values['arm.tool_link']:
            raise InvalidTask("parameter arm.tool_link = '': expected the link that carries the "
                              'gripper, of robot_description, for execute.through = joints')
        if not values['execute.horizon']:
            raise InvalidTask('parameter execute.horizon = 0: expected how much of the coming '
                              'motion joints are told, s, for execute.through = joints')
    choice('parameter far_end.hold', values['far_end.hold'], ('free', *GRIPS))
    for name in ('frame_id', 'tool.frame_id', 'far_end.frame_id'):
        if not values[name].strip():
            raise InvalidTask(f'parameter {name} = {values[name]!r}: expected the name of a frame')
    if values['rod.grasped_at'] and values['far_end.hold'] != 'free':
        raise InvalidTask(f'parameter far_end.hold = {values["far_end.hold"]!r}: expected free, '
                          'rod.grasped_at says that both ends are')
    if values['rod.grasped_at'] and values['simulator.self_contact']:
        raise InvalidTask('parameter simulator.self_contact = True: expected False, both parts of '
                          'a DLO that is grasped inside, as rod.grasped_at says, do not know each '
                          'other')
    bounded('tool.position', values['tool.position'], values['workspace.reach'], 'm')


def _guards(values: Mapping[str, Any]) -> Guards:
    path, goal = 'constraints.path.', 'constraints.goal.'
    return Guards(values[path + 'position'], values[path + 'angle'], values[path + 'shape'],
                  values[goal + 'position'], values[goal + 'angle'],
                  values['constraints.goal_time'], values['cmd_timeout'],
                  values['incoming_command_timeout'], values['decelerate_on_cancel'],
                  values['execute.longest_pause'], values['execute.enable_timeout'],
                  'joint_states' if values['execute.through'] == 'joints' else 'gripper_pose',
                  values['constraints.pull_time'])


def _seeing(values: Mapping[str, Any]) -> EstimatorConfig:
    return EstimatorConfig(spread_of(values), **{
        item.name: values[f'observe.{item.name}'] for item in fields(EstimatorConfig)
        if item.name not in ('spread', 'robot_time')},
        robot_time=values['observe.robot_time'] or np.inf)
