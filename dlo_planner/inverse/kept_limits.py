"""Whether a motion keeps its limits: bounds of its speeds, accelerations and jerks at all times."""

import numpy as np

_TIGHT = 5e-3    # part of the largest that a bound may be above it
_ROUNDS = 40     # halvings of the time between two looks
_PARTS = 8       # of the time between two knots, for jerks


def most_used(leg, law, limits):
    """Return the largest part of its limits that a motion uses, at any time; not below the truth.

    An interval of time is halved until it cannot hold more than _TIGHT above what was found: sizes
    are known at its ends, and their slopes are bounded.

    Args:
        leg: Leg; law: TimeLaw; limits: Limits
    """
    most = limits.sizes
    times = np.unique(np.concatenate([[0.0], law.arrivals(leg.knots[1:-1]), [law.duration]]))
    a, b = times[:-1], times[1:]
    largest = _largest_jerk(leg, law, a, b, most[2])
    for _ in range(_ROUNDS):
        u, *rates = law.at(np.append(a, b))
        used = _sizes(leg, u, rates) / most[:2]
        largest = max(largest, used.max())
        bound = (used.reshape(2, -1, 2, 2).mean(axis=0) + 0.5 * (b - a)[:, None, None] * _slopes(
            leg, law, a, b) / most[:2]).max(axis=(1, 2))
        wide = bound > (1 + _TIGHT) * largest
        if not wide.any():
            return float(max(largest, bound.max()))
        a, b, middle = a[wide], b[wide], 0.5 * (a + b)[wide]
        a, b = np.append(a, middle), np.append(middle, b)
    return float(max(largest, bound.max()))


def _largest_jerk(leg, law, a, b, most):
    """Return a bound of the largest jerk as a part of the `most` (2,), not much above it."""
    shares = np.linspace(0, 1, _PARTS + 1)
    edges = a[:, None] + (b - a)[:, None] * shares
    return (_jerks(leg, law, edges[:, :-1].ravel(), edges[:, 1:].ravel()) / most).max()


def _sizes(leg, u, rates):
    """Return (n, 2, 2): sizes of speed and acceleration; linear and angular."""
    _, _, first, second = leg.at(u)
    rate, change = rates[0][:, None], rates[1][:, None]
    both = np.stack([rate * first, change * first + rate**2 * second], axis=1)
    return np.linalg.norm(both.reshape(len(u), 2, 2, 3), axis=3)


def _most(leg, law, a, b):
    """Return bounds between times a and b: (n, 2, 3) of the leg's derivatives, (n,) of u' to u'''.

    The leg's are linear and angular, first to third.
    """
    (before, *one), (after, *other) = law.at(a), law.at(b)
    change, jerk = law.bounds
    half = 0.5 * (b - a)
    return (leg.bounds(before, after), np.maximum(one[0], other[0]) + half * change,
            np.maximum(np.abs(one[1]), np.abs(other[1])) + half * jerk, jerk)


def _slopes(leg, law, a, b):
    """Return (n, 2, 2): bounds of the slopes of `_sizes` between times a and b."""
    bounds, rate, change, _ = _most(leg, law, a, b)
    first, second = np.moveaxis(bounds, 2, 0)[:2]
    return np.stack([change[:, None] * first + rate[:, None] ** 2 * second,
                     _jerks(leg, law, a, b)], axis=1)


def _jerks(leg, law, a, b):
    """Return (n, 2): bounds of the linear and angular jerk between times a and b."""
    bounds, rate, change, jerk = _most(leg, law, a, b)
    first, second, third = np.moveaxis(bounds, 2, 0)
    rate, change = rate[:, None], change[:, None]
    return jerk * first + 3 * rate * change * second + rate**3 * third
