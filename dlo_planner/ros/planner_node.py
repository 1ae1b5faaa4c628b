"""The node: gripper poses in, shapes out; cut-outs in, gripper trajectories out."""

import signal
import sys
from dataclasses import dataclass
from time import monotonic

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from visualization_msgs.msg import MarkerArray

from dlo_planner.errors import DloPlannerError
from dlo_planner.ros.causes import Cause
from dlo_planner.ros.drive import Drive, described
from dlo_planner.ros.executor import PatientExecutor
from dlo_planner.ros.health import Health
from dlo_planner.ros.live import LiveShapes
from dlo_planner.ros.parameters import ENTRIES, declare
from dlo_planner.ros.picture import Picture
from dlo_planner.ros.proving import Prover
from dlo_planner.ros.qos import LATCHED, REQUEST
from dlo_planner.ros.reporter import Reporter
from dlo_planner.ros.requests import Planning
from dlo_planner.ros.scene import build_scene
from dlo_planner.ros.state import State, Store
from dlo_planner.ros.surroundings import Surroundings
from dlo_planner.ros.verification import Verification
from dlo_planner.ros.warm_up import warm_up, warm_up_proofs
from msg_helpers.diagnostics import diagnostics_msg, status_msg

__all__ = ['LATCHED', 'REQUEST', 'PlannerNode', 'main']

_THREADS = 8    # one for each callback group below, and the default one
_ENDING = 2.0   # s in which a motion may come to rest when the node is told to end
_PICTURE = 0.03  # s between pictures, if something has changed
_LOOK = 0.05    # s between looks whether it has


@dataclass(frozen=True)
class Parts:
    """What the parts of the node share: Store, Health, Reporter, Picture."""

    store: Store
    health: Health
    reporter: Reporter
    picture: Picture


class PlannerNode(Node):
    """Predicts the DLO's shape live and plans the gripper's trajectory; see docs/ros_interface.md.

    Each part reads the State once when it is called; nobody changes that. Each has a callback
    group (and so a thread) of its own: shapes and commands go on while a plan is made.
    """

    def __init__(self, **options):
        super().__init__('dlo_planner', **options)
        declare(self)
        values = {name: self.get_parameter(name).value for name in ENTRIES}
        store = Store(State(build_scene(values), values))
        self._prover = Prover()
        self._warm_up(store.state.scene)  # before there is anything to be called
        self._store, self._health = store, Health()
        # Timers stand still with a clock of simulated time that does; these must not.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        reporter = Reporter(self, store, self._health)
        picture = Picture(self.create_publisher(MarkerArray, '~/markers', LATCHED).publish)
        parts = Parts(store, self._health, reporter, picture)
        scene, hearing, asking, planning, proving, moving, health = (
            MutuallyExclusiveCallbackGroup() for _ in range(_THREADS - 1))
        self._health_out = self.create_publisher(DiagnosticArray, '/diagnostics', REQUEST)
        self._surroundings = Surroundings(self, parts, scene)
        self._live = LiveShapes(self, parts, hearing, asking)
        self._planning = Planning(self, parts, planning)
        self._verification = Verification(self, parts, self._prover, steady, proving)
        self._drive = Drive(self, parts, self._planning, steady, moving)
        self.create_timer(values['diagnostics_period'], self._publish_health,
                          callback_group=health, clock=steady)
        self.create_timer(_PICTURE, lambda: self._show(reporter, picture), callback_group=health,
                          clock=steady)

    def _warm_up(self, scene):
        self.get_logger().info('loading the solver; the very first start compiles it (minutes)')
        started = monotonic()
        warm_up()
        warm_up_proofs(self._prover)
        self.get_logger().info(f'ready after {monotonic() - started:.1f} s: {scene.name}, '
                               f'{scene.direct.rod.length:g} m')

    def wind_down(self, reason: str = 'the node ends'):
        """Let the motion come to rest and the planning end, for good; both go on for a moment."""
        self._planning.cancel(reason, for_good=True)
        self._drive.stop(Cause.SHUTDOWN, reason)

    @property
    def at_rest(self) -> bool:
        """Whether no command is sent any more."""
        return self._drive.at_rest

    def destroy_node(self):
        """End the process that proves plans, and the thread that predicts shapes, as well."""
        self._prover.close()
        self._live.close()
        super().destroy_node()

    def _show(self, reporter, picture):
        with reporter.answering('markers', told=False):
            picture.flush()

    def _publish_health(self):
        level, message, values = self._health.report()
        state, name = self._store.state, self.get_name()
        array = diagnostics_msg(f'{name}: solver', state.scene.name, level, message, values,
                                self.get_clock().now().to_msg())
        array.status = [*array.status, status_msg(f'{name}: execution', state.scene.name,
                                                  *described(state.execution))]
        self._health_out.publish(array)


def main(args=None):
    """Run the node until SIGINT or SIGTERM; return the exit status."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as SIGINT, until it spins
    # rclpy's own handlers end the context at once: a motion could not come to rest any more.
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    node = None
    try:
        node = PlannerNode()
        executor = PatientExecutor(num_threads=_THREADS)
        executor.add_node(node)
        spin(executor, node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (DloPlannerError, ParameterException) as error:
        print(f'dlo_planner: cannot start: {error}', file=sys.stderr)
        return 1
    except Exception:
        if rclpy.ok():  # what fails after the end was asked for, e.g. a wait set, is part of it
            raise
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def spin(executor, node):
    """Serve callbacks until SIGINT or SIGTERM, and until the motion has come to rest then.

    Args:
        executor: that has the node; node: PlannerNode
    """
    ending = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *found: ending.append(found[0]))
    while not ending:
        executor.spin_once(timeout_sec=_LOOK)
    node.wind_down()
    end = monotonic() + _ENDING
    while not node.at_rest and monotonic() < end:
        executor.spin_once(timeout_sec=_LOOK)


if __name__ == '__main__':
    sys.exit(main())
