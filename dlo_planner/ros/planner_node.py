# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The node: gripper poses in, shapes out; cut-outs in, gripper trajectories out."""

if __name__ == '__main__':  # before all imports, which are deaf to signals
    import sys

    from dlo_planner.ros.main import main
    sys.exit(main())

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Event, Thread
from time import monotonic, sleep
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from visualization_msgs.msg import MarkerArray

from dlo_planner.errors import DloPlannerError
from dlo_planner.execute.causes import Cause
from dlo_planner.ros.arm import ArmOutput
from dlo_planner.ros.drive import Drive, described
from dlo_planner.ros.estimate import Camera
from dlo_planner.ros.inputs import frames_of
from dlo_planner.ros.live import LiveShapes
from dlo_planner.ros.managed import LATCHED, REQUEST, Gate, ManagedNode
from dlo_planner.ros.markers import MarkerCache
from dlo_planner.ros.parameters import as_declared, declare
from dlo_planner.ros.plan import Planning
from dlo_planner.ros.proof import Verification
from dlo_planner.ros.scene import build_scene
from dlo_planner.ros.state import State, Store
from dlo_planner.ros.status import Health, Parts, Reporter
from dlo_planner.ros.surroundings import Surroundings
from dlo_planner.ros.warm_up import warm_up, warm_up_corrections, warm_up_loop, warm_up_proofs
from dlo_planner.ros.worker import Worker
from dlo_planner.settings.build import doubts
from dlo_planner.settings.parameters import ENTRIES
from msg_helpers.diagnostics import WARN, diagnostics_msg, status_msg

__all__ = ['LATCHED', 'REQUEST', 'THREADS', 'PlannerNode']

THREADS = 14    # one for each callback group: below, of transitions, of tf, and the default one
_GROUPS = 10
_RESTING = 4.5  # s in which a motion may come to rest when the node is told to end
_ENDING = 2.0   # s in which callbacks that run may end then
_LOOK = 0.02    # s between looks whether it has


class PlannerNode(ManagedNode):
    """Predicts the DLO's shape live and plans the gripper's trajectory; see docs/ros_interface.md.

    Each part reads the State once when it is called; nobody changes that. Each has a callback
    group (and so a thread) of its own: shapes and commands go on while a plan is made.

    Raises
    ------
    DloPlannerError, rclpy.exceptions.ParameterException
        A parameter makes no sense.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__('dlo_planner', **options)
        declare(self)
        direct = build_scene(self._values()).direct  # what makes no sense is said at once
        for doubt in doubts(direct.rod, direct.gravity):
            self.get_logger().warning(doubt)
        self.add_pre_set_parameters_callback(as_declared)
        # Timers stand still with a clock of simulated time that does; these must not.
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._gate: Any = None   # a Gate and Parts, while the node is configured
        self._parts: Any = None
        self._prover = Worker('proves plans')
        self._looping = Worker('plans in a closed loop')
        self._health_out = self.create_publisher(DiagnosticArray, '/diagnostics', REQUEST)
        period = self.get_parameter('diagnostics_period').value
        try:
            with self._telling(period):
                self._warm_up()
            self.show()
            self.create_timer(period, self._publish_health, clock=self._steady,
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
        return {name: self.get_parameter(name).value for name in ENTRIES}

    def _warm_up(self) -> None:
        self.get_logger().info('loading the solver (minutes, if it was not compiled at '
                               'installation and this is the first start)')
        started = monotonic()
        warm_up()
        # only what comes before this is ready waits for it; proofs and the loop have processes
        Thread(target=self._warm_up_rest, daemon=True).start()
        self.get_logger().info(f'the solver is loaded, after {monotonic() - started:.1f} s')

    def _warm_up_rest(self) -> None:
        with suppress(DloPlannerError):  # a process is started again for the first plan
            self._prover.result(warm_up_proofs)
            self._looping.result(warm_up_loop)
        warm_up_corrections()

    # ---- lifecycle ------------------------------------------------------------------------------

    def configure(self) -> None:
        """Read the parameters, build the scene, make all topics and services."""
        values = self._values()
        store = Store(State(build_scene(values), values))
        gate, health = Gate(self), Health()
        markers = gate.create_publisher(MarkerArray, '~/markers', LATCHED)
        picture = MarkerCache(markers.publish)
        parts = Parts(store, health, Reporter(gate, store, health), picture, frames_of(self))
        # rclpy takes a topic or timer of a group before its services, which would wait for good
        (scene, seeing, identifying, hearing, asking, resetting, planning, answering,
         moving, canceling) = (MutuallyExclusiveCallbackGroup() for _ in range(_GROUPS))
        self._surroundings = Surroundings(gate, parts, self._steady, scene)
        self._camera = Camera(gate, parts, seeing, identifying, self.set_parameters_atomically)
        self._live = LiveShapes(gate, parts, hearing, asking, resetting,
                                self._camera.gripper)
        arm = ArmOutput(gate)
        arm.subscribe(hearing)
        self._verification = Verification(gate, parts, self._prover, arm)
        self._planning = Planning(gate, parts, self._verification.look, planning, answering)
        self._drive = Drive(gate, parts, self._planning, self._camera.observing, self._looping,
                            self._steady, moving, canceling)
        Thread(target=picture.run, args=(
            lambda: gate.is_open and bool(markers.get_subscription_count()),
            gate.counted(self._show_picture)), daemon=True).start()
        self._gate, self._parts, self._store, self._health = gate, parts, store, health

    def activate(self) -> None:
        """Answer, and hear the gripper."""
        self._planning.allow()
        self._gate.open()
        self._drive.announce()
        self._verification.look()
        scene = self._parts.store.state.scene
        self.get_logger().info(f'ready: {scene.name}, {scene.direct.rod.length:g} m')

    def deactivate(self) -> None:
        """Let the motion come to rest and the planning end; answer no more."""
        if self._gate is None:
            return
        reason = 'the node ends, or is deactivated'
        self._planning.cancel(reason, for_good=True)
        end = monotonic() + _RESTING
        while not self._drive.at_rest and monotonic() < end:
            self._drive.stop(Cause.SHUTDOWN, reason)
            sleep(_LOOK)
        self._gate.shut(_ENDING)

    def clean_up(self) -> None:
        """Take all topics and services back; forget shape, plan and obstacles."""
        if self._gate is None:
            return
        self._gate.shut(_ENDING)
        self._live.close()
        self._verification.close()
        self._parts.picture.close()
        self._surroundings.close()
        self._parts.frames.close()
        self._gate.destroy()
        self._gate = self._parts = None

    def destroy_node(self) -> None:
        """End the processes that plan and prove, and the thread that predicts shapes, as well."""
        self._end_workers()
        self.clean_up()
        super().destroy_node()

    def _show_picture(self) -> None:
        with self._parts.reporter.answering('markers', told=False):
            self._parts.picture.flush()

    # ---- diagnostics ----------------------------------------------------------------------------

    @contextmanager
    def _telling(self, period: float) -> Iterator[None]:
        """Publish diagnostics all the time, though nothing spins yet."""
        over = Event()

        def tell() -> None:
            self._publish_health()
            while not over.wait(period):
                self._publish_health()

        thread = Thread(target=tell, name='starting', daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def _publish_health(self) -> None:
        self._health_out.publish(self._diagnostics())

    def _diagnostics(self) -> DiagnosticArray:
        parts, name, stamp = self._parts, self.get_name(), self.get_clock().now().to_msg()
        if parts is None or self.lifecycle_state != 'active':
            text = {'starting': 'starting: the solver is being loaded'}.get(
                self.lifecycle_state, f'not active: {self.lifecycle_state}')
            return diagnostics_msg(f'{name}: solver', self.get_parameter('rod.name').value, WARN,
                                   text, {'lifecycle': self.lifecycle_state}, stamp)
        level, message, values = parts.health.report()
        state = parts.store.state
        array = diagnostics_msg(f'{name}: solver', state.scene.name, level, message,
                                {**values, 'lifecycle': 'active'}, stamp)
        array.status = [*array.status, status_msg(f'{name}: execution', state.scene.name,
                                                  *described(state.execution, state.looking))]
        return array
