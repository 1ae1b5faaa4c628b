# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a request ended, as a number: one table for `~/status`, the answers and the documentation."""

from enum import IntEnum

from dlo_planner.errors import (
    DeadlineExceeded,
    DloPlannerError,
    Infeasible,
    InvalidRod,
    InvalidTask,
    NotConverged,
)


class Cause(IntEnum):
    """0 done, 1xx bad input, 2xx planning, 3xx proof, 4xx execution, 5xx the node itself."""

    _value_: int
    meaning: str

    def __new__(cls, number: int, meaning: str = '') -> 'Cause':
        """Return the member with a meaning."""
        cause = int.__new__(cls, number)
        cause._value_, cause.meaning = number, meaning
        return cause

    DONE = 0, 'done as asked'
    INVALID_REQUEST = 100, 'a field or a value of the request makes no sense'
    INVALID_FRAME = 101, 'a pose is given in a frame that cannot be transformed to `frame_id`'
    INVALID_POSE = 102, 'a coordinate is not finite, or a quaternion is not of length 1'
    OUT_OF_REACH = 103, 'a pose is farther from the origin than `workspace.reach`'
    IN_OBSTACLE = 104, 'the gripper is inside an obstacle'
    INVALID_GOALS = 105, '`task_goals` has no pose, or more than 100'
    INVALID_OBSTACLES = 106, 'a marker is not understood; nothing of its message counts'
    INVALID_PARAMETER = 107, 'a parameter, or several together, make no sense'
    NO_GOAL = 108, ('`replan` before there was a task, or a service for a task of which nothing '
                    'is known')
    INVALID_POINTS = 109, ('`observed_points` has no x, y, z, or too few points, or a stamp of '
                           'another time')
    NOTHING_SEEN = 110, '`identify` before anything of the DLO was seen'
    TOO_MANY_CALLS = 111, 'so many calls wait before this one that it was refused at once'
    INFEASIBLE = 200, 'no plan keeps all demands, for another reason than the next ones'
    UNSTABLE = 201, 'a waypoint has no stable shape'
    WORKSPACE = 202, 'the gripper would leave its workspace, or come into an obstacle'
    COLLISION = 203, 'the DLO would come into a sheet or an obstacle'
    OVERBENT = 204, 'the DLO would bend or yield more than it may'
    NO_SHAPE = 205, 'no stable shape was found for a gripper pose'
    PLANNING_DEADLINE = 206, 'the plan was not found within `threading.planning_deadline`'
    PLANNING_CANCELED = 207, '`cancel` was called, or the node ends, while the plan was made'
    SCENE_CHANGED = 208, 'obstacles or parameters changed while the plan was made'
    FAR_END_HELD = 209, ('the far end or another place is held: what is asked for is of a DLO that '
                         'the gripper alone holds')
    NO_ROOM = 210, ('the DLO does not pass the hole, along its normal or obliquely, or with less '
                    'than `threading.margin`: the message says what would help')
    PROOF_PENDING = 300, 'the plan is still being checked: ask again'
    NOT_FOLLOWED = 301, 'replayed slowly, the DLO does not follow the plan'
    NOT_CALM = 302, 'no motion along the plan keeps all demands and leaves the DLO at rest'
    PROOF_DEADLINE = 303, ('no motion that leaves the DLO at rest was found within '
                           '`threading.deadline`')
    PROOF_PROCESS = 304, 'the process that proves plans ended, again and again'
    PROOF_FAILED = 305, 'the plan could not be checked'
    NO_PLAN = 400, 'there is no plan, or the last one is void'
    EXECUTING = 401, 'a plan is being executed'
    NO_GRIPPER_POSE = 402, 'no gripper pose has come'
    OLD_GRIPPER_POSE = 403, 'the last gripper pose is older than `incoming_command_timeout`'
    NOT_AT_START = 404, 'the gripper is not where the plan begins'
    CANCELED = 405, '`cancel` was called'
    PATH_TOLERANCE = 406, 'the gripper left its command by more than `constraints.path.*`'
    SHAPE_TOLERANCE = 407, 'the observed DLO left its plan by more than `constraints.path.shape`'
    GOAL_TOLERANCE = 408, 'the gripper did not come within `constraints.goal.*` in time'
    GRIPPER_POSE_LOST = 409, 'no gripper pose younger than `incoming_command_timeout` came'
    OBSTACLES_CHANGED = 410, 'obstacles changed: the plan is void'
    PARAMETERS_CHANGED = 411, ('a parameter of the DLO, the tool or the limits changed: the plan '
                               'is void')
    PAUSED = 412, ('the node stood still for longer than `execute.longest_pause`, or than '
                   'commands were sent ahead')
    SHUTDOWN = 413, 'the node ends'
    NOTHING_TO_CANCEL = 414, '`cancel`, and nothing was planned, proved or executed'
    MISS_EXPECTED = 415, 'the observed DLO is not inside the cut-out with 95 %: it stops before it'
    NOT_ENABLED = 416, '`enable` is not true, or older than `execute.enable_timeout`'
    LIMITS = 417, 'the motion would exceed the limits of speed, acceleration or jerk'
    OTHER_PLAN = 418, ('several nodes ask for plans, and another one has come since: name the one '
                       'to be executed, by `execute_plan`')
    LOOKS_DISAGREE = 419, ('what is seen of the DLO does not agree with what was expected: it '
                           'stops, and goes back before the cut-out')
    ARM = 420, ('the joints of the arm cannot follow: out of reach, a limit, links that come '
                'together, or too little is known of the arm')
    PULL = 421, ('the gripper has pulled so hard, for `constraints.pull_time`, that a fitting may '
                 'be overloaded, or `measured_wrench` has fallen silent')
    INTERNAL = 500, 'an error of the node itself; the log has its place'


class Refused(DloPlannerError):
    """A request that the node refuses; `cause` is the number of the reason."""

    def __init__(self, cause: Cause, message: str) -> None:
        super().__init__(message)
        self.cause = cause


_OF_CONSTRAINT = {'stability': Cause.UNSTABLE, 'clearance': Cause.COLLISION,
                  'margin': Cause.NO_ROOM,
                  'max_bend_curvature': Cause.OVERBENT, 'yield': Cause.OVERBENT}


def cause_of(error: Exception) -> Cause:
    """Return the number of the reason that an exception stands for."""
    if isinstance(error, Refused):
        return error.cause
    if isinstance(error, Infeasible):
        if error.constraint.startswith('workspace'):
            return Cause.WORKSPACE
        return _OF_CONSTRAINT.get(error.constraint, Cause.INFEASIBLE)
    kinds = {DeadlineExceeded: Cause.PLANNING_DEADLINE, NotConverged: Cause.NO_SHAPE,
             InvalidRod: Cause.INVALID_PARAMETER, InvalidTask: Cause.INVALID_REQUEST}
    return next((cause for kind, cause in kinds.items() if isinstance(error, kind)),
                Cause.INTERNAL)
