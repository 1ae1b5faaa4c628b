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

    DONE = 0
    INVALID_REQUEST = 100
    INVALID_FRAME = 101
    INVALID_POSE = 102
    OUT_OF_REACH = 103
    IN_OBSTACLE = 104
    INVALID_GOALS = 105
    INVALID_OBSTACLES = 106
    INVALID_PARAMETER = 107
    NO_GOAL = 108
    INVALID_POINTS = 109
    NOTHING_SEEN = 110
    INFEASIBLE = 200
    UNSTABLE = 201
    WORKSPACE = 202
    COLLISION = 203
    OVERBENT = 204
    NO_SHAPE = 205
    PLANNING_DEADLINE = 206
    PLANNING_CANCELED = 207
    SCENE_CHANGED = 208
    FAR_END_HELD = 209
    PROOF_PENDING = 300
    NOT_FOLLOWED = 301
    NOT_CALM = 302
    PROOF_DEADLINE = 303
    PROOF_PROCESS = 304
    PROOF_FAILED = 305
    NO_PLAN = 400
    EXECUTING = 401
    NO_GRIPPER_POSE = 402
    OLD_GRIPPER_POSE = 403
    NOT_AT_START = 404
    CANCELED = 405
    PATH_TOLERANCE = 406
    SHAPE_TOLERANCE = 407
    GOAL_TOLERANCE = 408
    GRIPPER_POSE_LOST = 409
    OBSTACLES_CHANGED = 410
    PARAMETERS_CHANGED = 411
    PAUSED = 412
    SHUTDOWN = 413
    NOTHING_TO_CANCEL = 414
    MISS_EXPECTED = 415
    NOT_ENABLED = 416
    LIMITS = 417
    OTHER_PLAN = 418
    LOOKS_DISAGREE = 419
    INTERNAL = 500


MEANINGS = {
    Cause.DONE: 'done as asked',
    Cause.INVALID_REQUEST: 'a field or a value of the request makes no sense',
    Cause.INVALID_FRAME: 'a pose is given in a frame that cannot be transformed to `frame_id`',
    Cause.INVALID_POSE: 'a coordinate is not finite, or a quaternion is not of length 1',
    Cause.OUT_OF_REACH: 'a pose is farther from the origin than `workspace.reach`',
    Cause.IN_OBSTACLE: 'the gripper is inside an obstacle',
    Cause.INVALID_GOALS: '`task_goals` has no pose, or more than 100',
    Cause.INVALID_OBSTACLES: 'a marker is not understood; nothing of its message counts',
    Cause.INVALID_PARAMETER: 'a parameter, or several together, make no sense',
    Cause.NO_GOAL: '`replan` before there was a task, or a service for a task of which nothing is '
                   'known',
    Cause.INVALID_POINTS: '`observed_points` has no x, y, z, or too few points, or a stamp of '
                          'another time',
    Cause.NOTHING_SEEN: '`identify` before anything of the DLO was seen',
    Cause.INFEASIBLE: 'no plan keeps all demands, for another reason than the next ones',
    Cause.UNSTABLE: 'a waypoint has no stable shape',
    Cause.WORKSPACE: 'the gripper would leave its workspace, or come into an obstacle',
    Cause.COLLISION: 'the DLO would come into a sheet or an obstacle',
    Cause.OVERBENT: 'the DLO would bend or yield more than it may',
    Cause.NO_SHAPE: 'no stable shape was found for a gripper pose',
    Cause.PLANNING_DEADLINE: 'the plan was not found within `threading.planning_deadline`',
    Cause.PLANNING_CANCELED: '`cancel` was called, or the node ends, while the plan was made',
    Cause.SCENE_CHANGED: 'obstacles or parameters changed while the plan was made',
    Cause.FAR_END_HELD: 'the far end is held: plans and motions are of a DLO whose end is free',
    Cause.PROOF_PENDING: 'the plan is still being checked: ask again',
    Cause.NOT_FOLLOWED: 'replayed slowly, the DLO does not follow the plan',
    Cause.NOT_CALM: 'no calm motion along the plan keeps all demands',
    Cause.PROOF_DEADLINE: 'no calm motion was found within `threading.deadline`',
    Cause.PROOF_PROCESS: 'the process that proves plans ended, again and again',
    Cause.PROOF_FAILED: 'the plan could not be checked',
    Cause.NO_PLAN: 'there is no plan, or the last one is void',
    Cause.EXECUTING: 'a plan is being executed',
    Cause.NO_GRIPPER_POSE: 'no gripper pose has come',
    Cause.OLD_GRIPPER_POSE: 'the last gripper pose is older than `incoming_command_timeout`',
    Cause.NOT_AT_START: 'the gripper is not where the plan begins',
    Cause.CANCELED: '`cancel` was called',
    Cause.PATH_TOLERANCE: 'the gripper left its command by more than `constraints.path.*`',
    Cause.SHAPE_TOLERANCE: 'the observed DLO left its plan by more than `constraints.path.shape`',
    Cause.GOAL_TOLERANCE: 'the gripper did not come within `constraints.goal.*` in time',
    Cause.GRIPPER_POSE_LOST: 'no gripper pose younger than `incoming_command_timeout` came',
    Cause.OBSTACLES_CHANGED: 'obstacles changed: the plan is void',
    Cause.PARAMETERS_CHANGED: 'a parameter of the DLO, the tool or the limits changed: the plan '
                              'is void',
    Cause.PAUSED: 'the node stood still for longer than `execute.longest_pause`, or than the robot '
                  'was told ahead',
    Cause.SHUTDOWN: 'the node ends',
    Cause.NOTHING_TO_CANCEL: '`cancel`, and nothing was planned, proved or executed',
    Cause.MISS_EXPECTED: 'the observed DLO is not inside the cut-out with 95 %: it stops before it',
    Cause.NOT_ENABLED: '`enable` is not true, or older than `execute.enable_timeout`',
    Cause.LIMITS: 'the motion would exceed the limits of speed, acceleration or jerk',
    Cause.OTHER_PLAN: 'another plan has come since: name the one to be executed, by `execute_plan`',
    Cause.LOOKS_DISAGREE: 'what is seen of the DLO does not agree with what was expected: it '
                          'stops, and goes back before the cut-out',
    Cause.INTERNAL: 'an error of the node itself; the log has its place',
}


class Refused(DloPlannerError):
    """A request that the node refuses; `cause` is the number of the reason."""

    def __init__(self, cause: Cause, message: str) -> None:
        super().__init__(message)
        self.cause = cause


_OF_CONSTRAINT = {'stability': Cause.UNSTABLE, 'clearance': Cause.COLLISION,
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
