"""From where the gripper is to where a threading begins, without touching the sheet.

The gripper backs off along the normal, turns, and goes straight to where the free end is `standoff`
before the centre, and then in it. While it only translates, a DLO that is behind the sheet at both
ends of the way is behind it all along; where it turns, it has to keep away by as much as may happen
between two poses. The shortest way back that allows that is taken; from farther than its length the
DLO cannot reach the sheet at all.
"""

import numpy as np

from dlo_planner.direct.continuation import between, shape_change
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.continuity import same
from dlo_planner.inverse.draft import Draft
from dlo_planner.inverse.plan import Waypoint
from dlo_planner.model.pose import Pose

_MARGIN = 0.02        # of the length
_LONGEST = 0.1        # of the length, and
_SHARPEST = 0.15      # rad: between two waypoints
_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the way back that is safe in any case


def start_phase(simulator, cutout, start, first, standoff, initial, brief):
    """Return the Plan from `start` to the Shape `first` (where a threading begins).

    Args:
        simulator: DirectSimulator
        cutout: CutOut; start: Pose of the gripper
        first: Shape where the threading begins
        standoff: m, between the free end and the centre where the last straight way begins
        initial: Shape at `start`; None: the natural shape set down there
        brief: Brief
    """
    behind = float((cutout.centre - start.position) @ cutout.normal)
    back = max(0.0, (1 + _MARGIN) * simulator.rod.length + brief.radius - behind)
    refused = None
    for share in _SHARES if back else (0.0,):
        try:
            return _from_behind(simulator, cutout, start, first, standoff, initial, brief,
                                share * back)
        except Infeasible as error:
            if refused is None or error.waypoint >= refused.waypoint:
                refused = error
    raise refused


def _from_behind(simulator, cutout, start, first, standoff, initial, brief, back):
    """Return the Plan that goes `back` (m) before it turns."""
    length, normal, goal = simulator.rod.length, cutout.normal, first
    first = first.gripper
    reaches = (cutout.centre - start.position) @ normal + back < length + brief.radius
    away = start.position - back * normal
    before = Pose.from_rotation(first.position - standoff * normal, first.rotation)
    turned = Pose.from_rotation(away, first.rotation)
    legs = [_way(start, Pose.from_rotation(away, start.rotation), length),
            _way(Pose.from_rotation(away, start.rotation), turned, length),
            _way(turned, before, length), _way(before, first, length)]
    grippers = [start, *(gripper for leg in legs for gripper in leg)]
    turning = range(len(legs[0]) + 1, len(legs[0]) + len(legs[1]) + 1)
    draft = Draft(np.zeros(len(grippers)), brief, 'start phase, waypoint')
    for index, gripper in enumerate(grippers):
        initial = simulator.track([gripper], initial=initial)[0]
        if not initial.converged:
            raise draft.refusal('equilibrium', initial.residual, 'no stable shape is found')
        room = float(((cutout.centre - initial.positions) @ normal).min()) - brief.radius
        wanted = _SHARPEST * length if index in turning and reaches else 0.0
        last = index == len(grippers) - 1  # there the free end is in the hole
        if room < wanted and not last and (index in turning or standoff > brief.radius):
            raise draft.refusal('clearance', wanted - room, 'the DLO is not behind the sheet' if
                                room < 0 else f'the DLO would turn {room:.3g} m behind the sheet')
        if last and not same(initial, goal):
            raise draft.refusal('start', shape_change(initial, goal), 'the DLO does not come into '
                                'the shape in which the threading begins')
        draft.add(Waypoint(initial, clearances=((np.inf, np.inf if last else room, np.inf),)))
    return draft.finished()


def _way(one, other, length):
    """Return Poses from `one`, which is left out, to `other`; none where they are the same."""
    shift = np.linalg.norm(other.position - one.position)
    cosine = np.clip(0.5 * (np.trace(other.rotation @ one.rotation.T) - 1), -1, 1)
    parts = int(np.ceil(max(shift / (_LONGEST * length), np.arccos(cosine) / _SHARPEST) - 1e-9))
    return [between(one, other, k / parts) for k in range(1, parts + 1)]
