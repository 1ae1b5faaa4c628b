# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a plan bears: by how much it misses when the DLO or the robot are not as assumed.

To first order from the sensitivities of the equilibrium, which separates the causes, and sampled,
which needs no smallness. A miss is the distance of the DLO, extended straight on where it is too
short to get there, from a center that it should pass.
"""

from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace

import numpy as np

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.penalties import Through
from dlo_planner.model.along import Expanded, Shifted, scaled
from dlo_planner.model.checks import figure, instance, integer, items, number, results
from dlo_planner.model.pose import displaced
from dlo_planner.model.value import Value, brief, put, same
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import OnProgress, Progress

_SMALL = 1e-3   # of a spread: step of the differences
_NEAR = 0.1     # of the length: how far from the planned arc length the DLO may pass a center
_AT_ONCE = 25   # samples in one piece of work


@dataclass(frozen=True, eq=False, repr=False)
class Spread(Value):
    """Standard deviations of what is not known exactly; all independent and normal.

    Attributes:
        bending_stiffness, torsional_stiffness, mass: relative, of EI_n and EI_b alike, of GJ, and
            of all masses alike
        length: m, of the part beyond the gripper
        natural_curvature: 1/m, of each of its two components, the same all along
        gripper_position: m, along each axis; gripper_rotation: rad, about each axis; constant
            during a plan, as a calibration is
        curvature_variation: 1/m, of each of the natural curvature's two components about its mean,
            as root mean square along the DLO: Legendre polynomials P_1, P_2, ..., the higher the
            less, see `variation_deviations`
    """

    bending_stiffness: float = 0.0
    torsional_stiffness: float = 0.0
    mass: float = 0.0
    length: float = 0.0
    natural_curvature: float = 0.0
    gripper_position: float = 0.0
    gripper_rotation: float = 0.0
    curvature_variation: float = 0.0

    def __post_init__(self):
        put(self, **{name: number(f'Spread.{name}', getattr(self, name), minimum=0)
                     for name in CAUSES})
        super().__post_init__()


CAUSES = tuple(field.name for field in fields(Spread))
# one number of a standard normal distribution for each, three or two for some
_VARIATION = 5  # Legendre polynomials by which the natural curvature varies
_DRAWN = tuple(name for name in CAUSES for _ in range(
    {'natural_curvature': 2, 'curvature_variation': 2 * _VARIATION, 'gripper_position': 3,
     'gripper_rotation': 3}.get(name, 1)))


def variation_deviations(count: int) -> np.ndarray:
    """Return (count,): standard deviations of the coefficients of P_1 ... P_count.

    Of a variation whose mean square along the DLO is 1: P_j has the mean square 1 / (2 j + 1), and
    its part of the whole falls like 1 / j^2, as in a curve whose slope is bounded.
    """
    j = np.arange(1, count + 1)
    return np.sqrt((2 * j + 1) / j**2 / np.sum(1 / j**2)) if count else np.zeros(0)


@dataclass(frozen=True, eq=False, repr=False)
class Robustness(Value):
    """How far off a plan is under a Spread; n waypoints, m samples.

    Attributes:
        causes: names in Spread
        by_cause: (n, len(causes)) root mean square of the miss due to each alone, to first order, m
        first_order: (n,) the same due to all together
        sampled: (m, n) misses of the samples, m; infinite where one has no stable shape
        success: part of the samples that miss by less than the room at the rim, at every waypoint;
            nan without samples or without a size of a cut-out
    """

    causes: tuple
    by_cause: np.ndarray
    first_order: np.ndarray
    sampled: np.ndarray
    success: float

    def __post_init__(self):
        causes = items('Robustness.causes', self.causes, str, least=1)
        first_order = results('Robustness.first_order', self.first_order, (None,))
        by_cause = results('Robustness.by_cause', self.by_cause, (None, len(causes)))
        n = len(by_cause)
        if first_order.size != n:
            raise InvalidTask(f'Robustness.by_cause has {n} rows, Robustness.first_order '
                              f'{first_order.size} entries: expected as many')
        put(self, causes=causes, first_order=first_order, by_cause=by_cause,
            sampled=results('Robustness.sampled', self.sampled, (None, n)),
            success=figure('Robustness.success', self.success))
        super().__post_init__()

    def __repr__(self):
        return brief(self, f'{self.first_order.size} waypoints',
                     f'first order {self.first_order.max(initial=0):.2g} m',
                     f'worst {self.worst}' if self.first_order.any() else '',
                     f'{len(self.sampled)} samples' if len(self.sampled) else '',
                     '' if np.isnan(self.success) else f'success {self.success:.3g}')

    @property
    def worst(self) -> str:
        """Name of the cause that hurts most: whose miss is the largest of all waypoints."""
        return self.causes[int(np.argmax(self.by_cause.max(axis=0)))]

    def quantile(self, part: float) -> np.ndarray:
        """Return (n,): the miss that `part` (0 to 1) of the samples do not exceed, m.

        Raises:
            InvalidTask: no such part, or there are no samples
        """
        part = number('part', part, minimum=0, maximum=1)
        if not len(self.sampled):
            raise InvalidTask('samples = 0: expected some where a quantile is asked for')
        return np.sort(self.sampled, axis=0)[int(np.ceil(part * (len(self.sampled) - 1)))]


def robustness(simulator: DirectSimulator, plan: Plan, spread: Spread, *, samples: int = 0,
              seed: int = 0, executor: Executor | None = None, progress: OnProgress = None,
              deadline: float | None = None) -> Robustness:
    """Return the Robustness of a plan under a Spread.

    Args:
        simulator: DirectSimulator for which the plan was made
        plan: Plan of a threading, which is looked at without obstacles, or of a contact
        samples: how many to draw; 0: first order only
        seed: of the draws
        executor: a `concurrent.futures.Executor` for the samples, e.g. a ProcessPoolExecutor; None:
            one after the other. The result does not depend on it.
        progress: called as progress(done, total) after each batch of samples
        deadline: s of computing after which DeadlineExceeded is raised; None: no limit

    Raises:
        InvalidTask: an argument makes no sense; the message names it
        DeadlineExceeded: the deadline is over; samples that an executor has begun go on
    """
    clamping('simulator', simulator)
    if not len(instance('plan', plan, Plan)):
        raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
    if any(shape.s[-1] != simulator.rod.length for shape in plan.shapes):
        raise InvalidTask('plan: expected shapes of the simulator\'s whole DLO')
    instance('spread', spread, Spread)
    samples = integer('samples', samples, minimum=0, maximum=1_000_000)
    seed = integer('seed', seed, minimum=0, maximum=2**63)
    if executor is not None:
        instance('executor', executor, Executor)
    steps = Progress(progress, deadline)
    own = simulator._history is not None  # its set makes a rod of its own
    simulator = simulator.elastic()
    if not own and not all(_acts_alike(shape, simulator) for shape in plan.shapes):
        raise InvalidTask('simulator: expected the one for which the plan was made, with its rod, '
                          'gravity and load')
    if not any(shape.contacts for shape in plan.shapes):
        simulator = simulator.without_obstacles()  # a rim would hold it back, and hide the miss
    by_cause = _first_order(simulator.rod, plan, spread, steps)
    draws = np.random.default_rng(seed).normal(size=(samples, len(_DRAWN)))
    work = [(simulator, plan.shapes, plan.via_points, spread, draws[k:k + _AT_ONCE])
            for k in range(0, samples, _AT_ONCE)]
    run = map if executor is None else executor.map
    batches = [np.zeros((0, len(plan)))]
    for batch in run(_sampled, work):
        batches.append(batch)
        steps.done(len(batches) - 1, len(work))
    sampled = np.concatenate(batches)
    room = plan.clearances[:, :, 0].min(axis=1, initial=np.inf)
    success = np.nan
    if samples and np.isfinite(room).any():
        success = float((sampled < room).all(axis=1).mean())
    return Robustness(CAUSES, by_cause, np.sqrt((by_cause**2).sum(axis=1)), sampled, success)


def _acts_alike(shape, simulator):
    """Whether a Shape is of a simulator's rod with its gravity and load; obstacles may differ.

    So may the parameters of yielding: nothing yields here.
    """
    here = shape._discretization
    return here is not None and same(*(replace(around, obstacles=(), rod=replace(
        around.rod, yield_curvature=None, yield_torsion=None, section_model='ideal', hardening=0.0))
        for around in (here.surroundings, simulator.surroundings)))


def _first_order(rod, plan, spread, progress):
    """Return (n, causes) root mean square misses."""
    out = np.zeros((len(plan), len(CAUSES)))
    columns = [CAUSES.index(name) for name in _DRAWN]
    steps = [_SMALL * step for step, name in zip(np.eye(len(_DRAWN)), _DRAWN, strict=True)
             if getattr(spread, name)]
    rods = [(_varied(rod, spread, step), _varied(rod, spread, -step)) for step in steps]
    for k, (shape, passes) in enumerate(zip(plan.shapes, plan.via_points, strict=True)):
        if not passes or not steps:
            continue
        progress.check()
        sensitivity = Sensitivity(shape)
        squares = np.zeros((len(passes), len(CAUSES)))
        for step, both in zip(steps, rods, strict=True):
            ahead, back = (
                sensitivity.predicted(one) if one is not rod
                else sensitivity.moved(_twist(shape.gripper, spread, sign * step))
                for one, sign in zip(both, (1, -1), strict=True))
            for j, (center, s, _) in enumerate(passes):
                off = (_off(ahead, center, s) - _off(back, center, s)) / (2 * _SMALL)
                squares[j, columns[int(np.argmax(step))]] += off @ off
        out[k] = np.sqrt(squares[np.argmax(squares.sum(axis=1))])
    return out


def _sampled(work):
    """Return (m, n) largest misses of the samples that (m, k) draws stand for."""
    simulator, shapes, passes, spread, draws = work
    out = np.empty((len(draws), len(shapes)))
    for i, draw in enumerate(draws):
        rod = _varied(simulator.rod, spread, draw)
        varied = simulator if rod is simulator.rod else simulator.with_rod(rod)
        initial = None
        for k, shape in enumerate(shapes):
            gripper = displaced(shape.gripper, _twist(shape.gripper, spread, draw))
            # it starts where the plan does, and then goes its own way
            start = _stretched(shape, rod.length) if initial is None else initial
            found = varied.track([gripper], initial=start)[0]
            initial = found if found.converged else initial
            out[i, k] = max((np.linalg.norm(_off(found, center, s))
                             for center, s, _ in passes[k]), default=0.0)
            if not found.converged:
                out[i, k] = np.inf
    return out


def _stretched(shape, length):
    """Return a Shape on a mesh of another length, to start from."""
    share = length / shape.s[-1]
    return replace(shape, s=np.append(shape.s[:-1] * share, length), _discretization=None,
                   _history=None, _before=None)


def _off(shape, center, s):
    """Return (3,): from a center to where the DLO passes it."""
    return Through(center, max(0.0, min(s, shape.s[-1]) - _NEAR * shape.s[-1])).residuals(shape)


def _varied(rod, spread, draw):
    """Return the Rod that (k,) draws stand for; `rod` itself if they leave it alone."""
    by = {name: [d * getattr(spread, name) for d, drawn in zip(draw, _DRAWN, strict=True)
                 if drawn == name] for name in CAUSES}
    if not any(np.any(by[name]) for name in CAUSES if not name.startswith('gripper')):
        return rod
    # exp: relative deviations, which never make a stiffness negative
    bend, twist, mass = (float(np.exp(by[name][0])) for name in (
        'bending_stiffness', 'torsional_stiffness', 'mass'))
    length = rod.length + by['length'][0]
    known = rod.natural_curvature
    curve = np.array(by['natural_curvature'])
    natural = Shifted(known, curve) if callable(known) else tuple(curve + known)
    if spread.curvature_variation:
        terms = np.reshape(by['curvature_variation'], (_VARIATION, 2))
        terms = terms * variation_deviations(_VARIATION)[:, None]
        natural = Expanded(natural, np.vstack([np.zeros(2), terms]), length)
    return replace(
        rod, length=length, bending_stiffness=scaled(rod.bending_stiffness, bend),
        torsional_stiffness=scaled(rod.torsional_stiffness, twist),
        mass_per_length=scaled(rod.mass_per_length, mass),
        tip_mass=mass * rod.tip_mass,
        point_masses=tuple((min(s, length), mass * m) for s, m in rod.point_masses),
        natural_curvature=natural)


def _twist(gripper, spread, draw):
    """Return the gripper's deviation (6,), rotation before displacement, world axes."""
    turn, shift = (np.array([d * getattr(spread, name) for d, drawn in zip(
        draw, _DRAWN, strict=True) if drawn == name])
        for name in ('gripper_rotation', 'gripper_position'))
    return np.concatenate([gripper.rotation @ turn, gripper.rotation @ shift])
