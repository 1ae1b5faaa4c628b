# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Odd messages of every type that the node hears, drawn with a seed.

Each is a good one with some faults put in. With at least one fault it makes no sense, and has to be
refused; with none it is good, but unusual. Both have to leave the node as it was, or as asked.
"""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, WrenchStamped
from nav_msgs.msg import Goals
from rcl_interfaces.msg import Parameter, ParameterValue
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import Header, String
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner import Pose
from dlo_planner.settings.parameters import PARAMETERS
from msg_helpers.clouds import cloud_msg
from msg_helpers.poses import pose_msg

NOT_FINITE = (float('nan'), float('inf'), -float('inf'))
FLOATS = (*NOT_FINITE, 0.0, -0.0, 5e-324, 1e-300, 1.8e308, -1.8e308, 1e200, -1e20, 1e-9, 1.0, -1.0,
          np.pi, 0.5, 2**53 + 1.0, 1e6)
INTEGERS = (0, 1, -1, 2, 63, 2**31 - 1, -2**31, 2**63 - 1, -2**63)
TEXTS = ('', 'world', '/world', 'map', 'wörld', 'a' * 3000, 'no\nline', '\t', 'round', '{}', '%s')
FRAMES = ('', 'map', '/world', 'World', 'wörld', 'world ', 'tool0', 'a' * 500, 'no\nframe')
LAST_SECOND, LAST_NANOSECOND = 2**31 - 1, 2**32 - 1
MANY = 400        # markers, points
REACH = 1.5       # m, of what is good
ALMOST_FLOAT32 = 3e38


class Odd:
    """Draws messages.

    Args:
        rng: numpy Generator
        now: function that returns a builtin_interfaces/Time
    """

    def __init__(self, rng: np.random.Generator, now):
        self.rng, self._now = rng, now

    def one_of(self, items):
        return items[int(self.rng.integers(len(items)))]

    def spoiled(self, msg, faults: int, kinds):
        """Return the message after some faults, each one of `kinds`, functions that change it."""
        for _ in range(faults):
            self.one_of(kinds)(msg)
        return msg

    # ---- poses ------------------------------------------------------------------------------

    def pose(self) -> Pose:
        return Pose(self.rng.uniform(-REACH, REACH, 3), self.rng.normal(size=4))

    def stamp(self) -> Time:
        return self.one_of((self._now(), Time(), Time(sec=1), Time(sec=LAST_SECOND),
                            Time(sec=-5), Time(sec=LAST_SECOND, nanosec=LAST_NANOSECOND)))

    def pose_stamped(self, faults: int) -> PoseStamped:
        msg = PoseStamped(header=Header(frame_id='world', stamp=self.stamp()),
                          pose=pose_msg(self.pose()))
        return self.spoiled(msg, faults, (self._frame, self._position, self._quaternion))

    def wrench(self, faults: int) -> WrenchStamped:
        """Return a geometry_msgs/WrenchStamped, of which the size of the force counts."""
        msg = WrenchStamped(header=Header(frame_id=self.one_of(FRAMES), stamp=self.stamp()))
        msg.wrench.force.x = float(self.rng.normal())
        return self.spoiled(msg, faults, (self._force,))

    def _force(self, msg):
        msg.wrench.force.y = self.one_of(NOT_FINITE)

    def _frame(self, msg):
        msg.header.frame_id = self.one_of(FRAMES)

    def _position(self, msg):
        setattr(msg.pose.position, self.one_of('xyz'), self.one_of((*NOT_FINITE, 1e20, -1e300)))

    def _quaternion(self, msg):
        q = msg.pose.orientation
        values = self.one_of(((0.0,) * 4, (0.0, 0.0, 0.0, 1e200), (1.0,) * 4, (np.nan,) * 4,
                              (1e-200, 0.0, 0.0, 0.0), (0.0, 0.0, -np.inf, 1.0)))
        q.x, q.y, q.z, q.w = values

    def goals(self, faults: int) -> Goals:
        """Return a nav_msgs/Goals of one or two poses; with faults of none, too many or bad ones.

        Good ones are one pose: two cut-outs take long.
        """
        if faults and self.rng.random() < 0.5:
            number = self.one_of((0, 3, MANY))
            return Goals(header=Header(frame_id='world'),
                         goals=[self.pose_stamped(0) for _ in range(number)])
        return Goals(header=Header(frame_id=self.one_of(TEXTS)), goals=[self.pose_stamped(faults)])

    # ---- obstacles --------------------------------------------------------------------------

    def marker(self) -> Marker:
        """Return a good Marker far from where probes are answered."""
        kind = self.one_of((Marker.CUBE, Marker.SPHERE, Marker.CYLINDER))
        marker = Marker(ns=self.one_of(TEXTS), id=self.one_of((0, 1, 2, 2**31 - 1, -2**31)),
                        type=kind, action=Marker.ADD)
        marker.header.frame_id, marker.header.stamp = 'world', self.stamp()
        marker.pose = pose_msg(Pose(self.rng.uniform(5, 9, 3), self.rng.normal(size=4)))
        size = float(self.rng.uniform(0.01, 1))
        marker.scale.x = marker.scale.y = marker.scale.z = size
        return marker

    def markers(self, faults: int) -> MarkerArray:
        """Return a visualization_msgs/MarkerArray; one bad marker makes all of it bad."""
        number = self.one_of((1, 1, 2, 5, MANY))
        found = [self.marker() for _ in range(number)]
        if faults:
            self.spoiled(self.one_of(found), faults, (
                self._frame, self._position, self._quaternion, self._scale, self._kind,
                self._action))
        elif self.rng.random() < 0.2:
            found.append(Marker(action=self.one_of((Marker.DELETE, Marker.DELETEALL))))
        return MarkerArray(markers=found)

    def _scale(self, marker):
        setattr(marker.scale, self.one_of('xyz'), self.one_of((*NOT_FINITE, 0.0, -1.0, 1e9)))

    def _kind(self, marker):
        marker.type = self.one_of((Marker.ARROW, Marker.MESH_RESOURCE, 77, -1, 2**31 - 1))

    def _action(self, marker):
        marker.action = self.one_of((1, 77, -1, 2**31 - 1))

    # ---- points of the DLO ------------------------------------------------------------------

    def cloud(self, faults: int) -> PointCloud2:
        number = self.one_of((1, 3, 20, MANY))
        points = self.rng.uniform(-REACH, REACH, (number, 3))
        msg = cloud_msg(points, 'world', self.stamp())
        points[self.rng.random(points.shape) < 0.1] = self.one_of((*NOT_FINITE, ALMOST_FLOAT32))
        msg.data = points.astype('<f4').tobytes()
        return self.spoiled(msg, faults, (self._frame, self._fields, self._offsets, self._sizes))

    def _fields(self, msg):
        msg.fields = self.one_of(([], msg.fields[:2], [
            PointField(name=axis, offset=4 * k, datatype=self.one_of((1, 4, 0, 255)), count=1)
            for k, axis in enumerate('xyz')], [PointField(name='x')] * MANY))

    def _offsets(self, msg):
        msg.fields = [PointField(name=axis, offset=self.one_of((13, 2**32 - 1, 2**31)),
                                 datatype=self.one_of((7, 8)), count=2**32 - 1) for axis in 'xyz']

    def _sizes(self, msg):
        name = self.one_of(('point_step', 'row_step', 'height', 'width'))
        sizes = (2, 2**31, 2**32 - 1)  # two points are too few, two rows too many
        setattr(msg, name, self.one_of(sizes if name in ('height', 'width') else (0, 1, 7)))

    # ---- the robot --------------------------------------------------------------------------

    def joint_state(self, _) -> JointState:
        number = self.one_of((0, 1, 7, MANY))
        return JointState(name=[f'joint{int(self.rng.integers(10**9))}' for _ in range(number)],
                          position=[self.one_of(FLOATS) for _ in range(
                              number + self.one_of((0, 0, 1)))])

    def text(self, _) -> String:
        """Return a std_msgs/String where a robot's description is expected."""
        return String(data=self.one_of((*TEXTS, '<robot/>', '<robot name="r"><link/>', '<' * MANY)))

    def task(self, faults: int) -> String:
        """Return a std_msgs/String where a task is expected."""
        good = ('{type: Thread, cutout: {pose: {position: [0, 0, 1]}}}',
                '{type: Minimize, penalties: [{type: PositionAt, s: 1.0, target: [0.8, 0, 0.8]}]}')
        odd = ('{type: Thread, cutout: 3}', '{type: HoldContact, s: .nan}', '[' * 200, '*a',
               '{type: ThreadSequence, cutouts: [{}, 1]}', '{type: Shape}', '{type: [Thread]}')
        return String(data=self.one_of((*odd, *TEXTS, '{' * MANY) if faults else good))

    # ---- parameters -------------------------------------------------------------------------

    def parameter(self, faults: int) -> Parameter:
        """Return an rcl_interfaces/Parameter: any value of any type, or a good one."""
        if not faults:
            return self._good_parameter()
        name = self.one_of((*2 * [*PARAMETERS], 'rod.lenght', '', 'use_sim_time.x', 'a' * 999))
        return Parameter(name=name, value=self._bad_value(name))

    def _good_parameter(self):
        """Return one that changes a number by a little."""
        name = self.one_of([name for name, entry in PARAMETERS.items() if not entry.read_only and
                            type(entry.default) is float and entry.default > 0])
        value = PARAMETERS[name].default * float(self.rng.uniform(0.8, 1.0))
        return Parameter(name=name, value=ParameterValue(type=3, double_value=value))

    def _bad_value(self, name):
        """Return a ParameterValue that does not fit the parameter."""
        default = PARAMETERS[name].default if name in PARAMETERS else None
        odd = {0: {}, 77: {}, 1: {'bool_value': True}, 2: {'integer_value': self.one_of(INTEGERS)},
               3: {'double_value': self.one_of(NOT_FINITE)}, 4: {'string_value': '{no}'},
               5: {'byte_array_value': [b'\x00'] * 3}, 6: {'bool_array_value': [True] * 2},
               7: {'integer_array_value': [INTEGERS[-1]] * 5},
               8: {'double_array_value': [self.one_of(NOT_FINITE)] * self.one_of((1, 2, 3, 4, 9))},
               9: {'string_array_value': list(TEXTS)}}
        # what might fit after all, as inf for a wall that is not there
        fitting = {bool: (1,), int: (2,), float: (2, 3), str: (4,), list: (7, 8, 9)}
        kinds = [kind for kind in odd if kind not in fitting.get(type(default), ())]
        kind = self.one_of(kinds)
        return ParameterValue(type=kind, **odd[kind])
