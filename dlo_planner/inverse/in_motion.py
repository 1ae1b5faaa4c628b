"""A plan run through the dynamic simulation: how far the DLO is from where it should be."""

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.clearance import clearance, room_in
from dlo_planner.inverse.continuity import apart
from dlo_planner.model.surface import Surface

_PER_PERIOD = 25      # steps in a period of the DLO's slowest vibration
_FEWEST, _MOST = 150, 20_000  # steps of a run
_NEWTON = 4           # steps to the arc length that is nearest to a centre
_DOUBLINGS, _HALVINGS = 4, 3  # of the pace that is tried


class TooLong(InvalidTask):
    """A motion would take more steps than are simulated."""


class InMotion:
    """Runs a plan at any pace and judges what the DLO does.

    Args:
        simulator: DirectSimulator; plan: Plan
        way: Trajectory of the plan
        first: Shape at its beginning, at rest
        obstacles: tuple of obstacles whose clearance is wanted
        progress: Progress
    """

    def __init__(self, simulator, plan, way, first, obstacles, progress):
        self._simulator, self._plan, self._way = simulator, plan, way
        self._first, self._obstacles, self._progress = first, obstacles, progress

    def figures(self, scale, only=None):
        """Return the figures of `Report` in motion for a run that takes `scale` times as long.

        Args:
            only: name of the one that is wanted; None: all

        Raises:
            TooLong: the run has more than 20000 steps
        """
        duration = scale * self._way.duration
        steps = self._steps(duration)
        shares = np.linspace(0, self._way.duration, steps + 1)
        grippers = self._way.at(shares)[0]
        found = {'duration': duration, 'step': duration / steps}
        motion = self._simulator.simulate(grippers, duration / steps, self._first,
                                          progress=self._progress.done)
        passed = any(self._plan.passes)
        if not (motion.converged and self._first.converged):
            sheets = len(self._plan.sheets) + len(self._obstacles)
            return found | {'dynamic_miss': np.inf if passed else np.nan, 'swing': np.inf,
                            'dynamic_clearance': -np.inf if sheets else np.nan}
        if only in (None, 'dynamic_miss'):
            found['dynamic_miss'] = self._miss(motion.shapes, self._way.progress(shares))
        if only in (None, 'swing'):
            calm = self._simulator.track(grippers, self._progress.done, self._first)
            found['swing'] = max(apart(*pair) for pair in zip(motion.shapes, calm, strict=True))
        if only is None:
            found['dynamic_clearance'] = least_clearance(
                self._plan, self._obstacles, Surface.of(self._simulator.rod), motion.shapes)
        return found

    def _steps(self, duration):
        """Return how many steps a run takes."""
        period = slowest_period(self._simulator.rod)
        steps = max(_FEWEST, int(np.ceil(_PER_PERIOD * duration / period)))
        if steps > _MOST:
            raise TooLong(f'limits: the motion takes {duration:.3g} s, {steps} steps of '
                          f'1/{_PER_PERIOD} of the slowest period of {period:.3g} s: expected at '
                          f'most {_MOST} steps')
        return steps

    def _miss(self, shapes, done):
        """Return the largest distance in m from the centres, nan if there is none to be passed.

        Args:
            done: times of the plan (n,) at which the n shapes are
        """
        times = self._plan.times
        last = np.clip(np.searchsorted(times, done, side='right') - 1, 0, len(times) - 2)
        misses = [away for k, shape in zip(last, shapes, strict=True)
                  for away in _misses(shape, self._plan.passes[k], self._plan.passes[k + 1])]
        return float(max(misses, default=np.nan))


def _misses(shape, passes, later):
    """Yield the distances in m of a Shape from the centres to be passed between two waypoints.

    Args:
        passes, later: those of `Plan.passes` at both
    """
    for centre, s, _ in passes:
        then = _arc_length_at(centre, later)
        if then is not None:
            yield _distance(shape, centre, min(s, then), max(s, then))[0]
    # one that comes or ends between them is passed as long as the free end is beyond it
    for some, others in ((passes, later), (later, passes)):
        for centre, s, _ in some:
            if _arc_length_at(centre, others) is None:
                away, at = _distance(shape, centre, s, shape.s[-1])
                if at < shape.s[-1]:
                    yield away


def _arc_length_at(centre, passes):
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


def least_clearance(plan, obstacles, surface, shapes):
    """Return the least clearance in m of Shapes from a Plan's sheets and obstacles, nan if none."""
    rooms = [clearance(obstacles, surface, shape) for shape in shapes if obstacles]
    rooms += [room_in(*sheet, surface, shape).min() for sheet in plan.sheets for shape in shapes]
    return float(min(rooms, default=np.nan))


def slowest_period(rod):
    """Return the period (s) of the slowest vibration of a Rod held at one end, about."""
    s = np.linspace(0, rod.length, 33)
    mass = rod.length * rod.masses_per_length(s).mean() / 4 + rod.tip_mass
    # a tip mass on a cantilever; its own mass counts for about a quarter
    return 2 * np.pi * np.sqrt(max(mass, 1e-12) * rod.length**3 / (3 * min(rod.stiffness[1:])))


def fastest_scale(good, at_once):
    """Return the smallest scale of time found that is `good`, by doubling and halving.

    Args:
        good: function of a scale
        at_once: whether it is with the scale 1
    """
    high, low = (1.0, None) if at_once else (None, 1.0)
    for _ in range(_DOUBLINGS):
        tried = high / 2 if at_once else 2 * low
        if good(tried) != at_once:
            high, low = (high, tried) if at_once else (tried, low)
            break
        high, low = (tried, low) if at_once else (high, tried)
    if high is None:
        return np.inf
    for _ in range(_HALVINGS if low is not None else 0):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if good(middle) else (middle, high)
    return high
