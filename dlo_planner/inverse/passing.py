"""Where a plan wants the DLO to pass a centre, between its waypoints too."""

import numpy as np

_NEWTON = 4           # steps to the arc length that is nearest to a centre


def worst_miss(shape, passes, later):
    """Return the largest distance in m of a Shape from the centres to be passed, 0 if none is.

    Args:
        passes, later: those of `Plan.passes` at the waypoints before and after
    """
    return max(_misses(shape, passes, later), default=0.0)


def _misses(shape, passes, later):
    """Yield the distances in m of a Shape from the centres to be passed between two waypoints."""
    for centre, s, _ in passes:
        then = arc_length_at(centre, later)
        if then is not None:
            yield _distance(shape, centre, min(s, then), max(s, then))[0]
    # one that comes or ends between them is passed as long as the free end is beyond it
    for some, others in ((passes, later), (later, passes)):
        for centre, s, _ in some:
            if arc_length_at(centre, others) is None:
                away, at = _distance(shape, centre, s, shape.s[-1])
                if at < shape.s[-1]:
                    yield away


def arc_length_at(centre, passes):
    """Return the arc length (m) at which a centre is to be passed, None if it is not."""
    return next((s for other, s, _ in passes if np.array_equal(other, centre)), None)


def _distance(shape, centre, low, high):
    """Return the distance (m) of a DLO from a centre between two arc lengths, and where it is."""
    best = np.inf, low
    for begin in (low, 0.5 * (low + high), high):
        s = begin
        for _ in range(_NEWTON):
            axes, position = shape.frame_at(s)
            away = float(np.linalg.norm(position - centre))
            if away < best[0]:
                best = away, s
            s = min(max(s + axes[:, 0] @ (centre - position), low), high)
    return best


def first_centre(passes):
    """Return the centre (3,) that a plan's waypoints pass first, None if none does."""
    return next((one[0][0] for one in passes if one), None)


def arc_lengths_at(centre, passes):
    """Return (n,) the arc lengths in m at which a centre or None is passed, nan where it is not."""
    return np.array([np.nan if s is None else s
                     for s in (arc_length_at(centre, one) for one in passes)])


def holes_passed(plan, u):
    """Return (k, n) arc lengths at which the k centres of a Plan are passed at parameters u (n,).

    nan where one is not passed: before the waypoint at which it first is, and after the last one.
    """
    centres = []
    for passes in plan.passes:
        centres += [centre for centre, _, _ in passes
                    if not any(np.array_equal(centre, one) for one in centres)]
    out = np.full((len(centres), len(u)), np.nan)
    for row, centre in zip(out, centres, strict=True):
        s = [arc_length_at(centre, passes) for passes in plan.passes]
        known = np.array([k for k, one in enumerate(s) if one is not None])
        times = plan.times[known]
        inside = (u >= times[0]) & (u <= times[-1])
        row[inside] = np.interp(u[inside], times, [s[k] for k in known])
    return out


def held_after(plan):
    """Return the index of the waypoint after which a bore holds the DLO of a Plan; None: none."""
    held = [shape.far_end is not None for shape in plan.shapes]
    return max(held.index(True) - 1, 0) if any(held) else None


def means_to_touch(plan):
    """Whether a Plan has contacts, or a bore that holds the DLO."""
    return any(shape.contacts or shape.far_end is not None for shape in plan.shapes)
