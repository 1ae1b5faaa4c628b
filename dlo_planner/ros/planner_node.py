"""The node: gripper poses in, shapes out; cut-outs in, gripper trajectories out."""

if __name__ == '__main__':  # before all imports, which are deaf to signals
    import sys

    from dlo_planner.ros.main import main
    sys.exit(main())

import traceback
from contextlib import contextmanager
from functools import partial
from time import monotonic

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Goals, Path
from nav_msgs.srv import GetPlan
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory
from visualization_msgs.msg import MarkerArray

from dlo_planner.errors import DloPlannerError, InvalidTask, NotConverged
from dlo_planner.ros.execution import Execution, ready
from dlo_planner.ros.health import Health
from dlo_planner.ros.parameters import ENTRIES, build_scene, declare
from dlo_planner.ros.planning import Made, make_plan
from dlo_planner.ros.proof import Proof, proofs
from dlo_planner.ros.proving import Prover
from dlo_planner.ros.warm_up import warm_up, warm_up_proofs
from msg_helpers.diagnostics import diagnostics_msg
from msg_helpers.markers import obstacle_markers, plan_markers, shape_markers
from msg_helpers.obstacles import obstacles_after
from msg_helpers.paths import plan_path, shape_path
from msg_helpers.poses import pose_from_stamped, pose_stamped_msg, poses_from_goals
from msg_helpers.trajectories import timed_trajectory

# Sensor data, but one deep: a pose that was overtaken by a newer one is of no use to anybody.
LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
REQUEST = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
_QUIET = 1.0  # s between warnings about the same thing
_MOST_GOALS = 2
THREADS = 6  # one for each callback group below
_TIMED_STEP, _TIMED_MOST = 0.05, 20_000  # s between points of the timed trajectory; points
_LOOK = 0.1   # s between looks whether there is a plan to be proved


class PlannerNode(Node):
    """Predicts the DLO's shape live and plans the gripper's trajectory; see docs/ros_interface.md.

    Each callback works on the Scene it finds when it starts, which nobody changes. Planning has
    a callback group (and so a thread) of its own: shapes go on while a plan is made.
    """

    def __init__(self, **options):
        super().__init__('dlo_planner', automatically_declare_parameters_from_overrides=True,
                         **options)
        declare(self)
        self._scene = build_scene(self._values())
        self._prover = Prover()
        self._warm_up()  # before there is anything to be called: what can be seen is ready
        self._health = Health()
        self._warned = {}
        self._latest = None   # (scene, Shape) of the last pose
        self._goal = None     # Poses of the last cut-outs, one or two
        self._made = None     # Made, the last plan
        self._proving = None  # Made of which the proof has begun
        self._proof = None    # Proof of the last plan whose proof has begun, as far as it has come
        self._obstacles = {}      # (namespace, id) -> obstacle
        self._execution = Execution()
        self._drawn = {}      # name -> markers of the last shape, of the last plan
        self.add_on_set_parameters_callback(self._judge_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)

        live, planning, asking, health, proving, moving = (
            MutuallyExclusiveCallbackGroup() for _ in range(THREADS))
        self._shape_out = self.create_publisher(Path, '~/predicted_shape', LATCHED)
        self._plan_out = self.create_publisher(Path, '~/gripper_trajectory', LATCHED)
        self._timed_out = self.create_publisher(MultiDOFJointTrajectory,
                                                '~/gripper_trajectory_timed', LATCHED)
        self._markers_out = self.create_publisher(MarkerArray, '~/markers', LATCHED)
        self._health_out = self.create_publisher(DiagnosticArray, '/diagnostics', REQUEST)
        self._command_out = self.create_publisher(PoseStamped, '~/gripper_command', REQUEST)
        self.create_subscription(MarkerArray, '~/obstacles', self._on_obstacles, REQUEST,
                                 callback_group=live)
        self.create_subscription(PoseStamped, '~/gripper_pose', self._on_pose, LATEST,
                                 callback_group=live)
        self.create_subscription(PoseStamped, '~/task_goal', self._on_goal, REQUEST,
                                 callback_group=planning)
        self.create_subscription(Goals, '~/task_goals', self._on_goals, REQUEST,
                                 callback_group=planning)
        self.create_service(GetPlan, '~/plan_threading', self._on_plan_threading,
                            callback_group=planning)
        self.create_service(GetPlan, '~/plan_two_cutouts', self._on_plan_two_cutouts,
                            callback_group=planning)
        self.create_service(Trigger, '~/replan', self._on_replan, callback_group=planning)
        self.create_service(GetPlan, '~/predict_shape', self._on_predict_shape,
                            callback_group=asking)
        self.create_service(Trigger, '~/reset', self._on_reset, callback_group=live)
        self.create_service(Trigger, '~/execute', self._on_execute, callback_group=moving)
        self.create_service(Trigger, '~/cancel', self._on_cancel, callback_group=moving)
        self.create_timer(1 / self.get_parameter('execute.rate').value, self._command,
                          callback_group=moving)
        self.create_timer(_LOOK, self._prove, callback_group=proving)
        self.create_timer(self.get_parameter('diagnostics_period').value, self._publish_health,
                          callback_group=health)

    def _warm_up(self):
        self.get_logger().info('loading the solver; the very first start compiles it (minutes)')
        started = monotonic()
        warm_up()
        warm_up_proofs(self._prover)
        self.get_logger().info(f'ready after {monotonic() - started:.1f} s: {self._scene.name}, '
                               f'{self._scene.direct.rod.length:g} m')

    # ---- parameters -----------------------------------------------------------------------------

    def _values(self):
        return {name: self.get_parameter(name).value for name in ENTRIES}

    def _judge_parameters(self, parameters):
        changed = {p.name: p.value for p in parameters if p.name in ENTRIES}
        try:
            build_scene({**self._values(), **changed}, self._bodies())
        except Exception as error:  # whatever it is, it must not end the node
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, _):
        with self._answering('parameters'):
            self._scene = build_scene(self._values(), self._bodies())
            self._latest = None

    # ---- obstacles ------------------------------------------------------------------------------

    def _bodies(self):
        return tuple(self._obstacles.values())

    def _on_obstacles(self, msg):
        with self._answering('obstacles'):
            after = obstacles_after(self._obstacles, msg, self._scene.frame_id, 'obstacles')
            scene = build_scene(self._values(), tuple(after.values()))
            before, self._obstacles = len(self._obstacles), after
            if self._latest is not None:  # the DLO is where it was
                self._latest = (scene, self._latest[1])
            self._scene = scene
            self._draw('obstacles', obstacle_markers(self._bodies(), before, scene.frame_id,
                                                     self.get_clock().now().to_msg()))

    # ---- shapes ---------------------------------------------------------------------------------

    def _on_pose(self, msg):
        with self._answering('gripper_pose', 'poses refused'):
            self._health.count('poses received')
            started, scene = monotonic(), self._scene
            gripper = self._gripper(scene, msg, 'gripper_pose')
            known = self._latest
            initial = known[1] if known is not None and known[0] is scene else None
            shape = _believable(scene.direct.track([gripper], initial=initial)[0])
            self._latest = (scene, shape)
            if shape.jumped:
                self._warn('jump', 'the DLO jumped into another shape on the way to this pose')
            self._shape_out.publish(shape_path(shape, scene.frame_id, msg.header.stamp))
            self._health.shape_done(shape, monotonic() - started)
            self._draw('shape', shape_markers(shape, scene.direct.rod.radius, scene.frame_id,
                                              msg.header.stamp))

    def _on_predict_shape(self, request, response):
        with self._answering('predict_shape'):
            scene = self._scene
            gripper = self._gripper(scene, request.start, 'predict_shape.start')
            shape = _believable(scene.direct.solve(gripper))
            response.plan = shape_path(shape, scene.frame_id, request.start.header.stamp)
        return response

    def _on_reset(self, _, response):
        self._latest = None
        response.success = True
        response.message = 'the next pose starts from the natural shape'
        return response

    # ---- plans ----------------------------------------------------------------------------------

    def _on_goal(self, msg):
        with self._answering('task_goal', 'plans refused'):
            scene = self._scene
            goal = pose_from_stamped(msg, scene.frame_id, 'task_goal')
            self._plan(scene, [goal], self._gripper_now())

    def _on_goals(self, msg):
        with self._answering('task_goals', 'plans refused'):
            scene = self._scene
            goals = poses_from_goals(msg, scene.frame_id, 'task_goals')
            if not 1 <= len(goals) <= _MOST_GOALS:
                raise InvalidTask(f'task_goals.goals has {len(goals)} poses: expected one or two')
            self._plan(scene, goals, self._gripper_now())

    def _on_plan_threading(self, request, response):
        with self._answering('plan_threading', 'plans refused'):
            scene = self._scene
            start = self._gripper(scene, request.start, 'plan_threading.start')
            goal = pose_from_stamped(request.goal, scene.frame_id, 'plan_threading.goal')
            response.plan = self._plan(scene, [goal], start)
        return response

    def _on_plan_two_cutouts(self, request, response):
        with self._answering('plan_two_cutouts', 'plans refused'):
            scene = self._scene
            goals = [pose_from_stamped(msg, scene.frame_id, f'plan_two_cutouts.{name}')
                     for name, msg in (('start', request.start), ('goal', request.goal))]
            response.plan = self._plan(scene, goals, self._gripper_now())
        return response

    def _on_replan(self, _, response):
        with self._answering('replan', 'plans refused', response):
            if self._goal is None:
                raise InvalidTask('there is no goal yet: send one to ~/task_goal')
            path = self._plan(self._scene, self._goal, self._gripper_now())
            response.success = True
            response.message = f'{len(path.poses)} gripper poses'
        return response

    def _plan(self, scene, goals, start):
        """Plan, publish and return the trajectory of the tool frame as a Path.

        Args:
            goals: Poses of one or two cut-outs
            start: Pose of the gripper now, or None
        """
        self._goal = goals
        started = monotonic()
        known = self._latest
        plan, cutouts, before = make_plan(scene, goals, start,
                                          None if known is None else known[1])
        seconds = monotonic() - started
        stamp = self.get_clock().now().to_msg()
        back = scene.tool.inverse()
        path = plan_path([pose.compose(back) for pose in plan.grippers], plan.times,
                         scene.frame_id, stamp)
        self._plan_out.publish(path)
        self._draw('plan', plan_markers(cutouts, plan.grippers, scene.frame_id, stamp))
        self._health.plan_proved(Proof(plan))  # what was said of the plan before is over
        self._health.plan_done(plan, seconds, stamp)
        self._made = Made(scene, plan, before, stamp)
        self.get_logger().info(f'planned {len(plan)} gripper poses in {1e3 * seconds:.0f} ms, '
                               f'largest miss {plan.miss.max():.1e} m, '
                               f'smallest stability {plan.stability.min():.2f}')
        return path

    def _prove(self):
        """Have the last plan proved, and publish its trajectory; a newer plan comes first."""
        with self._answering('report'):
            made = self._made
            if made is None or made is self._proving:
                return
            self._proving = made
            replayed = partial(self._prover.report, lambda: self._made is made)
            for proof in proofs(replayed, made.scene, made.plan, made.before):
                if self._made is not made:
                    return
                self._proof = proof
                self._health.plan_proved(proof)
                if proof.safe:
                    self._publish_timed(made, proof.report)
                elif proof.done:
                    self._refuse('report', f'the plan is not safe: {proof.reason}')

    def _publish_timed(self, made, report):
        scene, way = made.scene, report.trajectory
        number = 1 + int(np.clip(np.ceil(way.duration / _TIMED_STEP), 1, _TIMED_MOST))
        self._timed_out.publish(timed_trajectory(way, number, scene.tool, scene.frame_id,
                                                 made.stamp))
        self.get_logger().info(f'the plan is safe: {way.duration:.1f} s, largest miss in motion '
                               f'{report.dynamic_miss:.1e} m, at most {way.tolerance:.1e} m')

    def destroy_node(self):
        """End the process that proves plans as well."""
        self._prover.close()
        super().destroy_node()

    # ---- execution ------------------------------------------------------------------------------

    def _on_execute(self, _, response):
        with self._answering('execute', answer=response):
            made = self._made
            way, scene = ready(made, self._proof, self._gripper_now()), made.scene
            self._execution.start(way, scene.tool, scene.frame_id, self._seconds())
            response.success = True
            response.message = f'{way.duration:.1f} s on gripper_command'
        return response

    def _on_cancel(self, _, response):
        response.success = self._execution.stop()
        response.message = 'stopped' if response.success else 'nothing was executed'
        return response

    def stop_motion(self):
        """Stop what is executed; return when it stands still."""
        self._execution.stop()

    def _command(self):
        with self._answering('execute'):
            command = self._execution.command(self._seconds())
            if command is not None:
                pose, frame_id = command
                self._command_out.publish(pose_stamped_msg(pose, frame_id,
                                                           self.get_clock().now().to_msg()))

    def _seconds(self):
        return 1e-9 * self.get_clock().now().nanoseconds

    # ---- common ---------------------------------------------------------------------------------

    def _draw(self, what, markers):
        """Publish all markers: whoever comes late gets one latched message and must see it all."""
        self._drawn = {**self._drawn, what: markers.markers}
        self._markers_out.publish(MarkerArray(markers=sum(self._drawn.values(), [])))

    def _gripper(self, scene, msg, name):
        return pose_from_stamped(msg, scene.frame_id, name).compose(scene.tool)

    def _gripper_now(self):
        known = self._latest
        return known[1].gripper if known is not None else None

    @contextmanager
    def _answering(self, what, counter=None, answer=None):
        """Let no exception out of a callback: refuse with a reason, keep the last good output.

        Args:
            what: is refused
            counter: of refusals, in Health
            answer: Trigger response that carries the reason
        """
        try:
            yield
        except DloPlannerError as error:
            self._refuse(what, f'{what} refused: {error}', counter, answer)
        except Exception as error:  # an exception that leaves a callback ends the node
            self.get_logger().error(traceback.format_exc())
            self._refuse(what, f'{what} failed: {type(error).__name__}: {error}', counter, answer)

    def _refuse(self, what, reason, counter=None, answer=None):
        if answer is not None:
            answer.success, answer.message = False, reason
        if counter is not None:
            self._health.count(counter)
        self._health.failed(reason)
        self._warn(what, reason)

    def _warn(self, key, text):
        now = monotonic()
        if now - self._warned.get(key, -np.inf) >= _QUIET:
            self._warned[key] = now
            self.get_logger().warning(text)

    def _publish_health(self):
        level, message, values = self._health.report()
        self._health_out.publish(diagnostics_msg(
            f'{self.get_name()}: solver', self._scene.name, level, message, values,
            self.get_clock().now().to_msg()))


def _believable(shape):
    if not shape.converged:
        raise NotConverged(f'no stable shape found: residual {shape.residual:.3g}, stability '
                           f'{shape.stability:.3g} after {shape.iterations} iterations', shape)
    return shape
