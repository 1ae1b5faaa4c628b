# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The node: gripper poses in, shapes out; cut-outs in, gripper trajectories out."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Event, Thread
from time import monotonic, sleep
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from visualization_msgs.msg import MarkerArray

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import DloPlannerError, InvalidTask
from dlo_planner.execute.causes import Cause
from dlo_planner.exercises import answers, closed_loop, first_shapes, looks, proofs
from dlo_planner.model.rod import doubts
from dlo_planner.ros.arm import ArmOutput
from dlo_planner.ros.arms import Arms
from dlo_planner.ros.estimate import Estimator
from dlo_planner.ros.inputs import Frames
from dlo_planner.ros.lifecycle import LATCHED, REQUEST, Desk, LifecycleNode
from dlo_planner.ros.markers import MarkerCache
from dlo_planner.ros.plan import PlanningServer
from dlo_planner.ros.predict import ShapePredictor
from dlo_planner.ros.proof import ProofServer
from dlo_planner.ros.scene import Scene
from dlo_planner.ros.scene_monitor import SceneMonitor
from dlo_planner.ros.state import State, Store
from dlo_planner.ros.status import Shared, Statistics, Status
from dlo_planner.ros.streaming import TrajectoryStreamer, described
from dlo_planner.ros.worker import Worker
from dlo_planner.settings.build import check_described, idle_warnings
from dlo_planner.settings.parameters import (
    PARAMETERS,
    ParameterSpec,
    as_declared,
    unknown_parameter,
)
from msg_helpers.diagnostics import WARN, diagnostics_msg, status_msg

__all__ = ['THREADS', 'PlannerNode']

# Of each group one callback runs at a time; a thread for each, of the lifecycle, of tf, the default
# one. rclpy takes the timers and topics of a group before its services, which would wait for good
# where those come quicker than they are done: no service shares a group with a topic.
_GROUPS = ('topics', 'tasks', 'looks', 'requests', 'control', 'commands')
THREADS = len(_GROUPS) + 3
_RESTING = 4.5  # s in which a motion may come to rest when the node is told to end
_ENDING = 2.0   # s in which callbacks that run may end then
_LOOK = 0.02    # s between looks whether it has
_COMPILED = 10.0  # s; kernels of shapes are loaded in two, and compiled in twenty or more
_COMPILING = 1800.0  # s that compiling all of the solver may take: minutes, ten times as slow


class PlannerNode(LifecycleNode):
    """Predicts the DLO's shape live and plans the gripper's trajectory; see docs/ros_interface.md.

    A parameter that makes no sense raises DloPlannerError or rclpy's ParameterException.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__('dlo_planner', **options)
        declare(self)
        direct = Scene.of(self._values()).direct  # what makes no sense is said at once
        for doubt in doubts(direct.rod, direct.gravity):
            self.get_logger().warning(doubt)
        self.add_pre_set_parameters_callback(typed)
        self.shared: Shared | None = None  # while the node is configured
        self._prover = Worker('proves plans')
        self._looping = Worker('plans in a closed loop')
        self._diagnostics_out = self.create_publisher(DiagnosticArray, '/diagnostics', REQUEST)
        period = self.get_parameter('diagnostics_period').value
        try:
            with self._telling(period):
                self._load(direct)
            self.show()
            self.create_timer(period, self._publish_diagnostics,
                              clock=Clock(clock_type=ClockType.STEADY_TIME),
                              callback_group=MutuallyExclusiveCallbackGroup())
            if self.get_parameter('autostart').value:
                self.start_up()
        except BaseException:
            self._end_workers()
            raise

    def _end_workers(self) -> None:
        for worker in (self._prover, self._looping):
            worker.close()

    def _values(self) -> dict[str, Any]:
        return {name: self.get_parameter(name).value for name in PARAMETERS}

    def _load(self, direct: DirectSimulator) -> None:
        """Use the kernels of shapes once, and the others in another thread.

        Only a request that comes before its kernels are loaded waits for them.
        """
        self.get_logger().info('loading the solver (half a minute, if it was not compiled at '
                               'installation and this is the first start)')
        started = monotonic()
        first_shapes(direct)
        if monotonic() - started > _COMPILED:
            self.loading.set()
        Thread(target=self._load_rest, name='loading', args=(started,), daemon=True).start()
        self.get_logger().info(f'shapes can be predicted, after {monotonic() - started:.1f} s')

    def _load_rest(self, started: float) -> None:
        """Use all other kernels; what is not compiled yet, a process compiles into files."""
        try:
            with suppress(DloPlannerError):  # a process is started again for the first plan
                self._prover.result(answers, patience=_COMPILING)
            answers()
        finally:
            self.loading.clear()
        with suppress(DloPlannerError):
            self._prover.result(proofs)
            self._looping.result(closed_loop)
        looks()
        self.get_logger().info(f'all of the solver is loaded, after {monotonic() - started:.1f} s')

    # ---- lifecycle ------------------------------------------------------------------------------

    def configure(self) -> None:
        """Read the parameters, build the scene, make all topics and services."""
        store, statistics = Store(State(Scene.of(self._values()))), Statistics()
        markers_out = self.add_publisher(MarkerArray, '~/markers', LATCHED)
        markers = MarkerCache(markers_out.publish)
        self.shared = shared = Shared(self, store, statistics, Status(self, store, statistics),
                                      markers, Frames(self))
        group = {name: MutuallyExclusiveCallbackGroup() for name in _GROUPS}
        # what takes long has a thread of its own for its calls, which are taken as they come
        self.desks = planning, asking = [
            Desk(group['requests'], shared.status.crowded) for _ in range(2)]
        self.scene_monitor = SceneMonitor(shared, group['topics'])
        self.estimator = Estimator(shared, group['looks'], asking)
        self.predictor = ShapePredictor(shared, group['control'], asking,
                                        self.estimator.gripper)
        arms = Arms(shared)
        arm = ArmOutput(self, group['topics'], self.predictor.hear)
        self.proof_server = ProofServer(shared, self._prover, arm)
        self.planning_server = PlanningServer(shared, self.proof_server.look, arms,
                                              group['tasks'], planning)
        self.streamer = TrajectoryStreamer(
            shared, self.planning_server, self.estimator.observing, self._looping, arm, arms,
            group['commands'], group['control'])

        def flush() -> None:
            with shared.status.answering('markers', told=False):
                markers.flush()

        Thread(target=markers.run, daemon=True, args=(
            lambda: self.is_open and bool(markers_out.get_subscription_count()),
            self.counted(flush))).start()

    def activate(self) -> None:
        """Answer, and hear the gripper."""
        assert self.shared is not None  # it is configured
        self.planning_server.allow()
        self.open()
        self.streamer.announce()
        self.proof_server.look()
        scene = self.shared.store.state.scene
        self.get_logger().info(f'ready: {scene["rod.name"]}, {scene.direct.rod.length:g} m')

    def deactivate(self) -> None:
        """Let the motion come to rest and the planning end; answer no more."""
        if self.shared is None:
            return
        reason = 'the node ends, or is deactivated'
        self.planning_server.cancel(reason, for_good=True)
        end = monotonic() + _RESTING
        while not self.streamer.at_rest and monotonic() < end:
            self.streamer.stop(Cause.SHUTDOWN, reason)
            sleep(_LOOK)
        self.shut(_ENDING)

    def clean_up(self) -> None:
        """Take all topics and services back; forget shape, plan and obstacles."""
        if self.shared is None:
            return
        self.shut(_ENDING)
        for one in (self.predictor, self.proof_server, self.scene_monitor, self.shared.markers,
                    self.shared.frames):
            one.close()
        for desk in self.desks:
            desk.close()
        self.destroy_entities()
        self.shared = None

    def destroy_node(self) -> None:
        """End the processes that plan and prove, and the thread that predicts shapes, as well."""
        self._end_workers()
        self.clean_up()
        super().destroy_node()

    # ---- diagnostics ----------------------------------------------------------------------------

    @contextmanager
    def _telling(self, period: float) -> Iterator[None]:
        """Publish diagnostics all the time, though nothing spins yet."""
        over = Event()

        def tell() -> None:
            self._publish_diagnostics()
            while not over.wait(period):
                self._publish_diagnostics()

        thread = Thread(target=tell, name='starting', daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def _publish_diagnostics(self) -> None:
        self._diagnostics_out.publish(self._diagnostics())

    def _diagnostics(self) -> DiagnosticArray:
        shared, name, stamp = self.shared, self.known_as, self.get_clock().now().to_msg()
        if shared is None or self.lifecycle_state != 'active':
            text = {'starting': 'starting: the solver is being loaded'}.get(
                self.lifecycle_state, f'not active: {self.lifecycle_state}')
            return diagnostics_msg(f'{name}: solver', self.get_parameter('rod.name').value, WARN,
                                   text, {'lifecycle': self.lifecycle_state}, stamp)
        level, message, values = shared.statistics.report()
        state = shared.store.state
        rod = state.scene['rod.name']
        array = diagnostics_msg(f'{name}: solver', rod, level, message,
                                {**values, 'lifecycle': 'active'}, stamp)
        array.status = [*array.status, status_msg(f'{name}: execution', rod,
                                                  *described(state.execution, state.looking))]
        return array


# ---- parameters ---------------------------------------------------------------------------------

_OF_RCLPY = ('use_sim_time', 'start_type_description_service')  # each node has these anyway


def take_overrides(node: Node) -> dict[str, object]:
    """Return the values given at the start, name -> value, and undeclare them."""
    names = [name for name in node.list_parameters([], 0).names if name not in _OF_RCLPY]
    values = {name: node.get_parameter(name).value for name in names}
    for name in names:
        node.undeclare_parameter(name)
    return values


def descriptor(entry: ParameterSpec) -> ParameterDescriptor:
    """Return the rcl_interfaces/ParameterDescriptor of an ParameterSpec."""
    made = ParameterDescriptor(description=entry.description, read_only=entry.read_only)
    if entry.lowest is None or entry.highest is None:
        return made
    if isinstance(entry.default, float):
        made.floating_point_range = [FloatingPointRange(
            from_value=float(entry.lowest), to_value=float(entry.highest), step=0.0)]
    else:
        made.integer_range = [IntegerRange(
            from_value=int(entry.lowest), to_value=int(entry.highest), step=1)]
    return made


def declare(node: Any) -> None:
    """Declare all parameters with the values given at the start; warn of those that do not exist.

    A DLO that is described in part is refused; where nothing is said of it, it is that of the
    launch file, as a warning says. Whole numbers in YAML are taken for doubles where
    doubles are due.
    """
    given = take_overrides(node)
    section = str(given.get('rod.section', PARAMETERS['rod.section'].default))
    if any(name.startswith('rod.') for name in given):
        check_described(given, section)
    else:
        node.get_logger().warning(
            'no parameter under rod. is given: the DLO is a copper wire, 1 m long and 1 mm thick; '
            'expected those of yours, by --params-file (config/ has files of some)')
    for warning in idle_warnings(given, section):
        node.get_logger().warning(warning)
    for name, entry in PARAMETERS.items():
        value = as_declared(name, given.pop(name, entry.default), entry.default)
        node.declare_parameter(name, value, descriptor(entry), ignore_override=True)
    for name in given:
        node.get_logger().warning(unknown_parameter(name, PARAMETERS))


def typed(parameters: list[Parameter]) -> list[Parameter]:
    """Return Parameters with whole numbers made floats where floats are declared.

    A pre-set callback: `ros2 param set dlo_planner rod.length 1` sends an integer. What cannot be
    made what is declared stays as it is, and is refused by rclpy.
    """
    result = []
    for parameter in parameters:
        entry = PARAMETERS.get(parameter.name)
        try:
            value = parameter.value if entry is None else as_declared(
                parameter.name, parameter.value, entry.default)
        except InvalidTask:
            value = parameter.value
        result.append(parameter if value is parameter.value or entry is None
                      else Parameter(parameter.name, value=value))
    return result
