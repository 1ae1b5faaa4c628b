"""From where the gripper is to where a threading begins, without touching the sheet.

The DLO reaches no farther than its length. So the gripper first backs off along the normal until it
is farther than that behind the sheet, turns there, and goes straight to where the free end is
`standoff` before the centre; while it only translates, a DLO that is behind the sheet at both ends
of the way is behind it all along.
"""

import numpy as np

from dlo_planner.direct.continuation import between
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.plan import PlanStatus, Waypoint, build_plan
from dlo_planner.model.pose import Pose

_MARGIN = 0.02        # of the length
_LONGEST = 0.1        # of the length, and
_SHARPEST = 0.15      # rad: between two waypoints


def start_phase(simulator, cutout, start, first, standoff, initial, speeds):
    """Return the Plan from `start` to the pose `first` (where a threading begins).

    Args:
        simulator: DirectSimulator
        cutout: CutOut; start, first: Poses of the gripper
        standoff: m, between the free end and the centre where the last straight way begins
        initial: Shape at `start`; None: the natural shape set down there
        speeds: m/s, rad/s
    """
    length, radius = simulator.rod.length, simulator.rod.radius or 0.0
    normal = cutout.normal
    behind = float((cutout.centre - start.position) @ normal)
    back = max(0.0, (1 + _MARGIN) * length + radius - behind)
    away = start.position - back * normal
    before = Pose.from_rotation(first.position - standoff * normal, first.rotation)
    corners = [start, Pose.from_rotation(away, start.rotation),
               Pose.from_rotation(away, first.rotation), before, first]
    grippers = [start]
    for one, other in zip(corners, corners[1:], strict=False):
        grippers += _way(one, other, length)
    waypoints = []
    for index, shape in enumerate(simulator.track(grippers, initial=initial)):
        room = float(((cutout.centre - shape.positions) @ normal).min()) - radius
        last = index == len(grippers) - 1  # there the free end is in the hole
        plan = None
        if not shape.converged:
            constraint, amount, why = 'equilibrium', shape.residual, 'no stable shape is found'
        elif room < 0 and not last and standoff > radius:
            constraint, amount, why = 'clearance', -room, 'the DLO is not behind the sheet'
        else:
            waypoints.append(Waypoint(shape, 0.0, 0.0, (), room))
            continue
        plan = build_plan(waypoints, np.zeros(len(grippers)), speeds, PlanStatus.PARTIAL)
        raise Infeasible(f'start phase, waypoint {index}: {why}', index, constraint, amount, plan)
    return build_plan(waypoints, np.zeros(len(grippers)), speeds, PlanStatus.COMPLETE)


def _way(one, other, length):
    """Return Poses from `one`, which is left out, to `other`."""
    shift = np.linalg.norm(other.position - one.position)
    cosine = np.clip(0.5 * (np.trace(other.rotation @ one.rotation.T) - 1), -1, 1)
    parts = int(np.ceil(max(shift / (_LONGEST * length), np.arccos(cosine) / _SHARPEST) - 1e-9))
    return [between(one, other, k / parts) for k in range(1, parts + 1)]
