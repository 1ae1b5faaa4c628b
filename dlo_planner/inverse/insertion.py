"""Insertion into a bore of about the DLO's own diameter (Zheng et al. 1991; paper, section 5.2).

The walls of the bore carry what is inside. If what is outside hangs as though it were cut off at
the mouth, with its end there in the bore's direction, the mouth has nothing to bear: no force, no
moment, no jamming. The roll of the DLO in the bore stays, so that nothing rubs. For a uniform DLO
the gripper then travels along the curve of its shape at the beginning; in general it is the
beginning of a threading with a shorter DLO at every depth.
"""

from dlo_planner.errors import Infeasible
from dlo_planner.inverse.beginnings import beginnings, with_free_end
from dlo_planner.inverse.continuity import refusal_for_leap
from dlo_planner.inverse.draft import Draft
from dlo_planner.inverse.one_point import aligned_shape
from dlo_planner.inverse.plan import waypoint_at
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.part import before
from dlo_planner.model.pose import Pose


def insert(simulator, bore, depths, start, brief):
    """Return the Plan; see `InverseSimulator.insert`."""
    refused = None
    for first, *_ in beginnings(simulator, bore, start):
        try:
            return _with_roll(simulator, bore, depths, first.frames[-1], brief)
        except Infeasible as error:
            if refused is None or error.waypoint > refused.waypoint:
                refused = error
    raise refused


def _with_roll(simulator, bore, depths, end, brief):
    """Return the Plan whose DLO has the frame `end` (3, 3) at the mouth."""
    draft = Draft(depths, brief)
    for depth in depths:
        outside = simulator.with_rod(before(simulator.rod, simulator.rod.length - depth))
        shape = _hanging(outside, end, bore)
        if shape is None:
            raise draft.refusal('equilibrium', depth, 'no equilibrium is free of force at the '
                                'mouth')
        if depth > 0:
            # the bore holds the end: that makes it more stable, and has to cost nothing
            mouth = FarEnd(Pose.from_rotation(bore.centre, shape.frames[-1]), 'sleeve')
            shape = outside.solve(shape.gripper, shape, far_end=mouth)
        if not shape.converged:
            raise draft.refusal('stability', -shape.stability, 'the DLO would not stay in the '
                                f'shape; stability {shape.stability:.3g}')
        refusal = refusal_for_leap(outside, draft, shape) if depth == 0 else None
        if refusal is not None:
            raise refusal
        draft.add(waypoint_at(shape, bore.centre, shape.s[-1], bore.normal))
    return draft.finished()


def _hanging(outside, end, bore):
    """Return the Shape whose free end is at the mouth with the frame `end`, or None."""
    guess = with_free_end(outside, end)
    shape = aligned_shape(outside, guess, outside.rod.length, bore.normal, guess.gripper.rotation)
    return None if shape is None else shape.moved(bore.centre - shape.positions[-1])
