# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What changes the scene: parameters, and obstacles as RViz shows them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from threading import Lock
from typing import Any

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from visualization_msgs.msg import MarkerArray

from dlo_planner.errors import DloPlannerError
from dlo_planner.execute.causes import Cause
from dlo_planner.model.rod import Surface, doubts
from dlo_planner.plan.clearance import clearance
from dlo_planner.plan.workspace import Workspace
from dlo_planner.ros.inputs import bodies_in, brief_text
from dlo_planner.ros.lifecycle import CHANGES
from dlo_planner.ros.scene import Scene, body_name
from dlo_planner.ros.state import State
from dlo_planner.ros.status import Part, Shared
from dlo_planner.settings.parameters import PARAMETERS
from dlo_planner.view.scene import cutout_primitives, obstacle_primitives

_LOOKS = 60       # poses of the gripper on the rest of its way that are looked at
_MOST_NAMED = 5   # obstacles that are named, or looked at


class SceneMonitor(Part):
    """Keeps the scene in line with parameters and obstacles."""

    def __init__(self, shared: Shared, topics: Any) -> None:
        super().__init__(shared)
        # A scene takes long to build. Whoever replaces it holds this from reading to writing:
        # shapes, plans and commands do not wait for it.
        self._rebuilding = Lock()
        self.node.add_on_set_parameters_callback(self._judge)
        self.node.add_post_set_parameters_callback(self._apply)
        self.node.add_latched(MarkerArray, '~/obstacles', self._on_obstacles, CHANGES, topics)
        scene = self.store.state.scene
        self._tell_standing(scene)
        if scene.standing.obstacles:
            self._show(scene)

    def close(self) -> None:
        """Judge and apply parameters no more."""
        self.node.remove_post_set_parameters_callback(self._apply)
        self.node.remove_on_set_parameters_callback(self._judge)

    def _judge(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        changed = {one.name: one.value for one in parameters if one.name in PARAMETERS}
        state = self.store.state
        scene = state.scene
        fixed = [name for name, value in changed.items() if not PARAMETERS[name].while_executing
                 and not _same(value, scene[name])]
        if state.executing and fixed:
            return SetParametersResult(successful=False, reason=f'parameter {", ".join(fixed)}: a '
                                       'plan is being executed: expected its end, or ~/cancel')
        try:
            Scene.of({**scene.values, **changed}, scene.bodies)
        except DloPlannerError as error:
            return SetParametersResult(successful=False, reason=brief_text(str(error)))
        except Exception as error:  # whatever it is, it must not end the node
            return SetParametersResult(successful=False, reason=brief_text(
                f'{type(error).__name__}: {error}'))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: Sequence[Parameter]) -> None:
        with self.status.answering('parameters', told=False), self._rebuilding:
            before = self.store.state.scene
            changed = {one.name: one.value for one in parameters if one.name in PARAMETERS}
            names = ', '.join(f'{name} = {value}' for name, value in changed.items()
                              if value != before[name])
            scene = Scene.of({**before.values, **changed}, before.bodies)
            if scene.direct.rod != before.direct.rod:
                for doubt in doubts(scene.direct.rod, scene.direct.gravity):
                    self.node.get_logger().warning(doubt)
            self._change(scene, Cause.PARAMETERS_CHANGED, f'parameters changed ({names})')
            if scene.standing != before.standing:
                self._tell_standing(scene)
                self._show(scene)

    def _on_obstacles(self, msg: MarkerArray) -> None:
        with self.status.answering('obstacles', told=False):
            with self._rebuilding:
                before, changed, reason = self._rebuilt(msg)
            if reason and before.executing:
                # it stops already: what is said of it now does not delay that
                said = in_the_way(before, changed)
                self.store.change(lambda now: now.with_detail(Cause.OBSTACLES_CHANGED,
                                                            f'{reason}: {said}'))

    def _rebuilt(self, msg: MarkerArray) -> tuple[State, dict[tuple[str, int], Any], str]:
        """Change the obstacles; return the State before, what is new, what has changed or ''."""
        before = self.store.state
        known = before.scene.bodies
        bodies = bodies_in(before.scene, msg, 'obstacles', self.frames)
        changed = [key for key in {**known, **bodies} if known.get(key) != bodies.get(key)]
        if not changed:
            return before, {}, ''
        reason = f'obstacles changed ({listed(changed)})'
        scene = Scene.of(before.scene.values, bodies)
        self._change(scene, Cause.OBSTACLES_CHANGED, reason)
        self._show(scene)
        return before, {key: bodies[key] for key in changed if key in bodies}, reason

    def _show(self, scene: Scene) -> None:
        """Show all obstacles, those of the file and those of markers, and the file's cut-outs."""
        standing, bodies = scene.standing, scene.bodies
        self.markers.show('obstacles', scene.frame_id, self.node.get_clock().now().to_msg(),
                          lambda: [*obstacle_primitives([
                              *standing.obstacles, *(body.obstacle for body in bodies.values())]),
                              *(replace(one, group=f'scene {one.group}')
                                for one in cutout_primitives(standing.cutouts))])

    def _tell_standing(self, scene: Scene) -> None:
        """Say in the log what the file of the cell was read as."""
        path, standing = scene['scene.file'], scene.standing
        if path:
            self.node.get_logger().info(f'{path}: {standing.counts}')
        for note in standing.notes:
            self.node.get_logger().info(brief_text(f'{path}: {note}'))

    def _change(self, scene: Scene, cause: Cause, reason: str) -> None:
        before = self.store.state
        state = self.store.change(lambda now: now.in_scene(scene, cause, reason))
        if before.planned is not None and state.planned is None:
            self.statistics.note({'report': 'void', 'report reason': reason})
            self.status.info(f'the plan is void: {reason}')


def _same(one: Any, other: Any) -> bool:
    return list(one) == list(other) if hasattr(one, '__len__') else bool(one == other)


def listed(keys: Sequence[tuple[str, int]]) -> str:
    """Return the names of obstacles in a line, some of them if there are many."""
    names = [body_name(key) for key in keys[:_MOST_NAMED]]
    more = len(keys) - len(names)
    return ', '.join(names) + (f' and {more} more' if more > 0 else '')


def in_the_way(state: State, bodies: Mapping[tuple[str, int], Any]) -> str:
    """Return in words which obstacles are in the way of what is still to be executed.

    The gripper is looked at along the rest of its way, the DLO in the planned shapes that are
    still to come.
    """
    assert state.execution is not None and state.running is not None
    plan, scene = state.running.plan, state.running.scene
    way, here = state.execution.way, state.execution.done
    grippers = way.poses(np.linspace(here, way.duration, _LOOKS))
    # in a closed loop it is another way, of which the plan is nearly the one
    since = float(way.progress([here])[0]) if state.looking is None else -np.inf
    shapes = [shape for shape, time in zip(plan.shapes, plan.times, strict=True) if time >= since]
    surface, radius = Surface.of(scene.direct.rod), scene.workspace.gripper_radius
    said = []
    for key, body in list(bodies.items())[:_MOST_NAMED]:
        space = Workspace(keep_out=(body.obstacle,), gripper_radius=radius)
        rooms = {'gripper': min(space.min_margin(pose)[1] for pose in grippers),
                 'DLO': min((clearance([body.obstacle], surface, shape) for shape in shapes
                             if body.role == 'all'), default=np.inf)}
        said += [f'{body_name(key)} is {-room:.3g} m in the way of the {who}'
                 for who, room in rooms.items() if room < 0]
    return '; '.join(said) or 'none of them is on the rest of the way'
