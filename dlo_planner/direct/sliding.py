# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that slides through rings: which places of it are in them, and whether they stay there.

For each choice of places s (one a ring) statics knows the shape that is held there, and its energy
E(s). Its slope D = dE/ds is what holds a ring's place back along the DLO: the jump of the material
force n . t + m . u - w from one side of the ring to the other (an Eshelby-like force: Bigoni, Dal
Corso, Bosi and Misseroni, 2013). Friction bears up to `slip` of it, and what is more lets the DLO
slide. So a step in which the places before were s0 ends in a local minimum of

    E(s) + sum of slip_i |s_i - s0_i|

(rate-independent friction; Mielke, 2005), which Newton's method finds: a place sticks where it was
as long as |D_i| <= slip_i, and slides with D_i = -+ slip_i else. The way counts: where the places
are in the end is what the next step begins with.

Meshes have a node in each ring, and are stretched evenly between those nodes when a place changes:
so E is a smooth function of s, of which D is the exact slope, errors of the mesh included.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.accuracy import fine_enough, refined
from dlo_planner.direct.discretization import Discretization, stretched
from dlo_planner.direct.equilibrium import halved
from dlo_planner.direct.grips import Grips, grips_at
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Feed, Shape
from dlo_planner.direct.statics import StepInputs, StepSolver, step
from dlo_planner.energy.loads import node_forces, node_masses
from dlo_planner.errors import InvalidTask
from dlo_planner.minimize.newton import HELD_NEUTRAL
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.model.checks import shown
from dlo_planner.model.holds import (
    Holds,
    alike,
    carried_on,
    have_rings,
    named,
    place_of,
    places_of,
    spans_of,
)
from dlo_planner.model.pose import Pose
from dlo_planner.model.supports import Surroundings
from dlo_planner.model.value import changed, freeze

_STEPS = 40           # of Newton's method at most
_TRIALS = 12          # halvings of one
_EXACT = 1e-8         # of the length: a step as small changes nothing, where
_ROUGHLY = 1e-6       # of the largest force speaks against a place
# Of the length and of the largest force: a step as small is none, where the last one made nothing
# less, and so much may speak against a place then
_UNSEEN, _LEFT = 1e-10, 1e-4
_NOISE = 1e-6         # the same, of one that does not make less what speaks against a place
_BALANCED = 1e-9      # of the largest force: what may speak against a place at the end
# Places are moved to both sides, to see how D answers, by a part of the length, but by no more than
# a part of the slack beside the ring: D goes as its inverse, so that differences err by (1/50)^2
_DIFFERENCE, _OF_SLACK = 1e-7, 0.02
_MESH_MOVED = 1e-6    # of the length: the same, of nodes alone, which costs no solution
_LONGEST = 0.15       # of the shorter part beside a ring: the longest step
_SLACK_LEFT = 0.3     # of what a part has to spare: what a step leaves of it at least
# of the distance: with which parts begin that would be out of reach, as much as can be; more pull
# tells Newton's method less
_SLACKS = 0.1, 0.03, 0.01, 1e-3, 1e-6
_STARTS = 3           # of these that are tried
_REACHED = 1e-7       # of the distance: slack at which a part is about to be taut
_END = 2e-3           # of the length: a ring nearer to the tip lets it go
_SAGS = 0.1            # of what friction leaves: a step that leaves more asks for another matrix
_KICK, _KICKS = 0.02, 3  # of the shorter part beside a ring: by which a saddle is left; how often
_CURVED = 1e-6        # of the largest: curvatures of E below it count as much
_STRETCHED = 1.5      # times the longest element at first: a longer one asks for another mesh
_SIGNS, _SWEEPS = 20, 200  # trials of which places slide; of the minimum, place by place
_PART = 1e-3          # of a step: what tells how D changes in it
_HALVINGS = 5         # of a step that is not found in one
_REFINED = 4          # meshes that are tried for an accuracy


def slid(solver: StepSolver, gripper: Pose, initial: Shape | None, holds: Holds,
         most: float = np.inf) -> Shape:
    """Return what `StepSolver.take` does where the DLO slides through rings.

    Its holds have the places that are in the rings then.

    Raises
    ------
    InvalidTask
        Something acts with which nothing is known to slide.
    """
    _refuse(solver.first.surroundings)

    def follow(before: Shape | None, goal: Grips, halvings: int) -> Shape:
        rings = _Rings(solver, goal, before, most)
        shape = rings.found()
        if shape.converged or before is None or not halvings or not rings.reached or not (
                before.converged and alike(before.holds, goal.holds)):
            return shape
        holds = carried_on(goal.holds, before.holds)
        middle = follow(before, grips_at(before, holds).towards(Grips(goal.gripper, holds), 0.5),
                        halvings - 1)
        if not middle.converged:
            return shape
        rest = follow(middle, goal, halvings - 1)
        return _after(middle, rest) if rest.converged else shape

    return follow(initial, Grips(gripper, holds), _HALVINGS)


def _after(one: Shape, other: Shape) -> Shape:
    """Return a Shape that counts what happened in the part of a step before it, too."""
    before, feed = one.state.feed, other.state.feed
    assert before is not None and feed is not None  # both slide
    return changed(other, iterations=one.iterations + other.iterations, state=changed(
        other.state, kicks=one.state.kicks + other.state.kicks,
        feed=feed._replace(work=before.work + feed.work)))


def _refuse(around: Surroundings) -> None:
    """Raise InvalidTask where the energy is no function of the places in the rings."""
    if around.rod.yields:
        raise InvalidTask('holds: expected none that the DLO slides through where the rod yields: '
                          'its set stays on its mesh')
    if around.self_contact:
        raise InvalidTask('self_contact = True: expected False where the DLO slides through a ring')
    if around.has_moments or around.other_loads:
        raise InvalidTask('point_loads: expected forces alone where the DLO slides through a ring, '
                          f'got {shown(around.point_loads)}')


class _Place(NamedTuple):
    """A DLO held at places of it, and what speaks against them."""

    shape: Shape   # held there by what does not slide
    s: Floats      # (n,) places in the rings, m
    slope: Floats  # (n,) D, N


class _Rings:
    """One step of a DLO that slides through n rings."""

    def __init__(self, solver: StepSolver, goal: Grips, initial: Shape | None,
                 most: float) -> None:
        self._solver, self._how = solver, StepInputs(solver.memory, most=most)
        self._first, self._accuracy = solver.first, solver.accuracy
        self._gripper, self._initial = goal.gripper, initial
        self._length = float(self._first.s[-1])
        self._holds = carried_on(goal.holds, () if initial is None else initial.holds)
        self._index: Ints = np.array([k for k, hold in enumerate(self._holds) if hold.is_ring])
        rings = [self._holds[k] for k in self._index]
        self._begin: Floats = np.array([hold.s for hold in rings], dtype=float)
        self._slip: Floats = np.array([hold.slip for hold in rings])
        self._bend = float(self._first.free.stiffness[:, 1:].min()) / self._length**3  # N/m
        self._steps = self._kicks = 0
        self.reached = True  # whether all is within reach, whatever is in the rings
        self._matrix: Floats | None = None  # (n, n) d2E/ds2, N/m; nan where it is not known
        known = None if initial is None else initial.state.feed
        if known is not None and known.stiffness.shape[0] == self._begin.size:
            self._matrix = known.stiffness.copy()

    # ---- the step --------------------------------------------------------------------------

    def found(self) -> Shape:
        """Return the Shape at the end of the step."""
        before = self._held_before()
        foreseen = self._foreseen(before)
        starts = self._reachable() if foreseen is None else [foreseen]
        self.reached = bool(starts)
        # else as it is where it does not slide: its status says what is too short
        for places in starts or [self._begin]:
            here = self._at(self._first_shape(places, before), places)
            if here.shape.converged:
                break
        if not starts:
            return self._ended(here, '')
        for _ in range(_REFINED):
            if not here.shape.converged:
                return self._ended(here, '')
            here, trouble = self._descended(here)
            if trouble or self._accuracy is None:
                break
            shape = self._ended(here, '')
            if fine_enough(shape, self._accuracy):
                break
            mesh = refined(shape.state.made_on, 'local', shape, self._accuracy)
            if mesh is None:
                break
            here = self._at(self._on(mesh, here), here.s)
        return self._ended(here, trouble)

    def _held_before(self) -> Shape | None:
        """Return the Shape before, held by what does not slide."""
        if self._initial is None or not have_rings(self._initial.holds):
            return self._initial
        return changed(self._initial, holds=_stuck(self._initial.holds))

    def _first_shape(self, places: Floats, before: Shape | None) -> Shape:
        """Return the Shape held at places (n,), from the one before the step."""
        if before is not None and self._initial is not None and before.state.mesh is not None and (
                alike(self._initial.holds, self._holds)):
            mesh, first = before.state.made_on, self._first
            if self._accuracy is not None or np.diff(mesh.s).max() <= (
                    _STRETCHED * np.diff(first.s).max()):
                return self._moved(before, places)
        return self._solver.take(self._gripper, before, self._held(places),
                                 self._how.most)

    def _moved(self, before: Shape, places: Floats) -> Shape:
        """Return the Shape held at places (n,), from one that is held at others."""
        holds = self._held(places)
        mesh = stretched(before.state.made_on, before.holds, holds, self._first)
        start = before.element_strains if mesh.s.size == before.s.size else None
        return self._beside(mesh, changed(before, holds=holds), holds, start)

    def _on(self, mesh: Discretization, here: _Place) -> Shape:
        """Return the Shape at the same places on another mesh."""
        holds = here.shape.holds
        return self._beside(mesh.with_nodes(places_of(holds)), here.shape, holds, None)

    def _beside(self, mesh: Discretization, known: Shape, holds: Holds,
                start: Floats | None) -> Shape:
        """Return the Shape in holds beside one that is known, from strains (N, 3) if any.

        A first shape has come to rest without friction. It has no way between the places that are
        tried, either: with friction on that none of them would be in balance.
        """
        how = self._how._replace(holds=holds)
        if self._initial is None and any(
                one.friction for one in self._first.surroundings.obstacles):
            if start is None:
                start = mesh.strains_from(known.s, known.element_strains)
            return step(mesh, self._gripper, None, how, start)
        return step(mesh, self._gripper, known, how, start)

    def _held(self, places: Floats) -> Holds:
        """Return what holds the DLO with places (n,) in the rings, and does not slide."""
        return _stuck(self._placed(places))

    def _placed(self, places: Floats) -> Holds:
        """Return the holds with places (n,) in the rings."""
        found = list(self._holds)
        for k, s in zip(self._index.tolist(), places.tolist(), strict=True):
            found[k] = found[k].at_place(s)
        return tuple(found)

    def _at(self, shape: Shape, places: Floats) -> _Place:
        slope = material_slope(shape)[self._index] if shape.converged else np.full(
            places.size, np.nan)
        return _Place(shape, places, slope)

    # ---- where the search begins -----------------------------------------------------------

    def _foreseen(self, before: Shape | None) -> Floats | None:
        """Return the places (n,) to which the DLO will slide, about, or None.

        To first order in the step: D of a small part of it tells how D would change.
        """
        initial = self._initial
        known = None if initial is None else initial.state.feed
        if (initial is None or before is None or known is None or not any(known.slides)
                or not initial.converged or not alike(initial.holds, self._holds)):
            return None
        slides = np.array(known.slides)
        matrix = known.stiffness[np.ix_(slides, slides)]
        goal = Grips(self._gripper, self._held(self._begin))
        near = Grips(before.gripper, before.holds).towards(goal, _PART)
        there = step(before.state.made_on, near.gripper, before,
                     self._how._replace(holds=near.holds), before.element_strains)
        if not there.converged or not np.isfinite(matrix).all():
            return None
        rate = ((material_slope(there) - known.forces)[self._index] / _PART)[slides]
        values, vectors = np.linalg.eigh(_symmetric(matrix))
        if values[0] <= 0.0:
            return None
        places = self._begin.copy()
        places[slides] -= vectors @ ((vectors.T @ rate) / values)
        # friction turns round: what would slide the other way sticks, as far as this can tell
        back = slides & (np.sign(places - self._begin) * known.forces[self._index] > 0) & (
            self._slip > 0)
        places[back] = self._begin[back]
        return places if self._leave_slack(self._begin, places, before.gripper) else None

    def _reachable(self) -> list[Floats]:
        """Return places (n,) near those before with which all is within reach, best first; or none.

        A part that is too short gets its length from the part beyond it, the last one from those
        before. It is left as much slack as it had, if that can be.
        """
        before = None if self._initial is None else spans_of(
            self._initial.holds, self._initial.gripper, self._length)
        spans = spans_of(self._holds, self._gripper, self._length)
        starts = list[Floats]()
        if all(span.distance < (1 - _REACHED) * span.length for span in spans):
            starts.append(self._begin)
        slacks = [[part * span.distance for span in spans] for part in _SLACKS]
        if before is not None and len(before) == len(spans):
            slacks.insert(0, [max(one.length - one.distance, least) for one, least in zip(
                before, slacks[-2], strict=True)])
        for least in slacks:
            found = self._shared([span.distance + one for span, one in zip(
                spans, least, strict=True)])
            if found is not None:
                starts.append(found)
        return starts[:_STARTS]

    def _shared(self, needs: list[float]) -> Floats | None:
        """Return places (n,) with which parts have at least the lengths `needs` (A,), or None."""
        places = [place_of(hold, self._length) for hold in self._holds]
        high, most = list(places), (1 - _END) * self._length
        for k in reversed(range(len(places))):
            if self._holds[k].is_ring:
                high[k] = most
            most = high[k] - needs[k]
        at, tiny = 0.0, 1e-12 * self._length
        for k, hold in enumerate(self._holds):
            least = at + needs[k]
            if high[k] < least - tiny:
                return None
            at = places[k] = min(max(places[k], least), high[k]) if hold.is_ring else places[k]
        return np.array([places[k] for k in self._index])

    # ---- Newton's method -------------------------------------------------------------------

    def _descended(self, here: _Place) -> tuple[_Place, str]:
        """Return where the descent ends, and in words why it is no equilibrium; ''."""
        fresh, left = False, np.inf  # whether the matrix is that of differences, near here
        for _ in range(_STEPS):
            rest, slides = self._rest(here)
            if not slides.any():
                return here, ''
            size = float(np.abs(rest).max())
            if self._matrix is None or not np.isfinite(self._matrix[np.ix_(slides, slides)]).all(
                    ) or size > _SAGS * left and not fresh:
                self._matrix, fresh = self._differences(here, slides), True
            stalled, left = size > _SAGS * left, size
            change = np.zeros_like(rest)
            values, vectors = np.linalg.eigh(_symmetric(self._matrix[np.ix_(slides, slides)]))
            scale = max(float(np.abs(values).max()), self._bend)
            curved = (vectors * np.maximum(np.abs(values), _CURVED * scale)) @ vectors.T
            change[slides] = _with_friction(curved, here.slope[slides], self._slip[slides],
                                            (here.s - self._begin)[slides])
            by = float(np.abs(change).max()) / self._length
            force = self._force(here)
            if (size <= _BALANCED * force or by <= _EXACT and size <= _ROUGHLY * force
                    or stalled and by <= _UNSEEN and size <= _LEFT * force):
                if not fresh:
                    self._matrix, fresh = self._differences(here, slides), True
                kicked = self._off_saddle(here, slides)
                if kicked is None:
                    return here, ''
                here, fresh, left = kicked, False, np.inf
                continue
            beyond = self._let_go(here, change)
            if beyond:
                return here, beyond
            after = self._trial(here, change, rest)
            if after is None:
                if by <= _NOISE:
                    return here, ''  # rounding
                if fresh:
                    return here, self._unbalanced(rest)
                left = 0.0  # the matrix may mislead
                continue
            self._learn(after.s - here.s, after.slope - here.slope)
            here, fresh = after, False
        return here, self._unbalanced(self._rest(here)[0])

    def _rest(self, here: _Place) -> tuple[Floats, Bools]:
        """Return (n,) what friction does not bear at each ring, N, and where the DLO slides."""
        moved = here.s - self._begin
        sticks = (moved == 0.0) & (self._slip > 0.0)
        bears = np.where(sticks, -np.clip(here.slope, -self._slip, self._slip),
                         self._slip * np.sign(moved))
        rest = here.slope + bears
        slides: Bools = ~sticks | (rest != 0.0)
        return rest, slides

    def _potential(self, here: _Place) -> float:
        """Return the energy and the work of friction, J."""
        return here.shape.energy + float(self._slip @ np.abs(here.s - self._begin))

    def _force(self, here: _Place) -> float:
        """Return the largest force of a hold, or one that bends the DLO, N."""
        return max(float(np.abs(here.shape.wrenches[:, :3]).max()), self._bend * self._length)

    def _parts(self, places: Floats) -> Floats:
        """Return (n,) the shorter of the parts beside each ring, m."""
        parts = np.diff([0.0, *places_of(self._placed(places)), self._length])
        shorter: Floats = np.minimum(parts[:-1], parts[1:])[self._index]
        return shorter

    def _trial(self, here: _Place, change: Floats, rest: Floats) -> _Place | None:
        """Return where a part of a change (n,) of the places leads; None: none is any good."""
        change = change * min(1.0, float((_LONGEST * self._parts(here.s) / np.maximum(
            np.abs(change), 1e-300)).min()))
        now, size, tiny = self._potential(here), np.abs(rest).max(), 1e-14 * self._length
        for _ in range(_TRIALS):
            places = here.s + change
            sticks = (np.abs(places - self._begin) < tiny) & (self._slip > 0)
            places[sticks] = self._begin[sticks]
            if self._leave_slack(here.s, places):
                there = self._at(self._moved(here.shape, places), places)
                self._steps += 1
                self._kicks += there.shape.state.kicks
                if there.shape.converged:
                    left = float(np.abs(self._rest(there)[0]).max())
                    gain = now - self._potential(there)
                    noise = 1e-13 * (abs(now) + self._force(here) * self._length)
                    if gain > noise or left < 0.5 * size and gain > -noise:
                        return there
            change = 0.5 * change
        return None

    def _leave_slack(self, before: Floats, places: Floats, gripper: Pose | None = None) -> bool:
        """Whether parts keep enough slack with places (n,) of what there was `before`.

        The gripper was at `gripper` then, if it is not where it was.
        """
        for one, other in zip(
                spans_of(self._placed(before), gripper or self._gripper, self._length),
                spans_of(self._placed(places), self._gripper, self._length), strict=True):
            if other.length - other.distance < _SLACK_LEFT * (one.length - one.distance):
                return False
        return bool(self._holds[-1].s is None
                    or places[-1] < (1 - 0.5 * _END) * self._length
                    or not self._holds[-1].is_ring)

    def _let_go(self, here: _Place, change: Floats) -> str:
        """Return in words that the DLO is about to slide out of its last ring; '' if it is not."""
        last = self._holds[-1]
        if last.is_ring and here.s[-1] > (1 - _END) * self._length and change[-1] > 0.0:
            return f'the DLO slides out of {named(last)}: its tip is there'
        return ''

    def _unbalanced(self, rest: Floats) -> str:
        k = int(np.argmax(np.abs(rest)))
        return (f'{abs(rest[k]):.2g} N along the DLO are not borne at '
                f'{named(self._holds[self._index[k]])}: where it slides to is not found')

    def _differences(self, here: _Place, slides: Bools) -> Floats:
        """Return (n, n) how D answers to the places that slide, N/m; nan beside."""
        matrix = np.full((here.s.size,) * 2, np.nan)
        steps = np.clip(_OF_SLACK * self._least_slacks(here.s), _UNSEEN * self._length,
                        _DIFFERENCE * self._length)
        for k in np.flatnonzero(slides):
            beside = [here]
            for by in (-steps[k], steps[k]):
                places = here.s.copy()
                places[k] += by
                there = self._at(self._moved(here.shape, places), places)
                if there.shape.converged:
                    beside.append(there)
            if len(beside) > 1:
                one, other = beside[-2:]  # on both sides, if there is a shape on both
                matrix[:, k] = (other.slope - one.slope) / (other.s[k] - one.s[k])
            else:
                matrix[:, k] = 0.0
                matrix[k, k] = self._bend
        return matrix

    def _least_slacks(self, places: Floats) -> Floats:
        """Return (n,) the lesser of what the parts beside each ring have to spare, m."""
        slack = np.array([span.length - span.distance for span in spans_of(
            self._placed(places), self._gripper, self._length)])
        lesser: Floats = np.minimum(slack, np.append(slack[1:], np.inf))[self._index]
        return lesser

    def _learn(self, moved: Floats, answered: Floats) -> None:
        """Let the matrix answer as the DLO did (Broyden)."""
        if self._matrix is None:
            return
        known = np.isfinite(self._matrix[0])
        size = float(moved[known] @ moved[known])
        if size > 0.0 and not np.any(moved[~known]):
            block = self._matrix[:, known]
            self._matrix[:, known] = block + np.outer(answered - block @ moved[known],
                                                      moved[known]) / size

    def _feed_stability(self, slides: Bools) -> tuple[float, Floats]:
        """Return the lowest curvature of E by what slides, without unit, and its mode (n,)."""
        mode = np.zeros(slides.size)
        if not slides.any() or self._matrix is None:
            return np.inf, mode
        block = self._matrix[np.ix_(slides, slides)]
        if not np.isfinite(block).all():
            return np.inf, mode
        values, vectors = np.linalg.eigh(_symmetric(block))
        mode[slides] = vectors[:, 0]
        return float(values[0]) / self._bend, mode

    def _off_saddle(self, here: _Place, slides: Bools) -> _Place | None:
        """Return a place beside a saddle, lower than it; None if it is none, or left too often."""
        lowest, mode = self._feed_stability(slides)
        if lowest >= -HELD_NEUTRAL or self._kicks >= _KICKS:
            return None
        best, size = None, _KICK * float((self._parts(here.s) / np.maximum(
            np.abs(mode), 1e-300)).min())
        for sign in (1.0, -1.0):
            places = here.s + sign * size * mode
            if self._leave_slack(here.s, places):
                there = self._at(self._moved(here.shape, places), places)
                if there.shape.converged and (best is None or self._potential(
                        there) < self._potential(best)):
                    best = there
        if best is None or self._potential(best) >= self._potential(here):
            return None
        self._kicks += 1
        return best

    # ---- its end ---------------------------------------------------------------------------

    def _ended(self, here: _Place, trouble: str) -> Shape:
        """Return the Shape of the step, held by rings."""
        shape, state = here.shape, here.shape.state
        rest, slides = (np.zeros(0), np.zeros(here.s.size, dtype=bool)) if not (
            shape.converged) else self._rest(here)
        lowest, _ = self._feed_stability(slides)
        forces = np.full(len(self._holds), np.nan)
        forces[self._index] = here.slope
        matrix = np.full((here.s.size,) * 2, np.nan) if (
            self._matrix is None) else self._matrix.copy()
        work = float(self._slip @ np.abs(here.s - self._begin))
        falls = lowest < -HELD_NEUTRAL
        if falls and not trouble:
            trouble = 'the DLO does not stay in its rings as it is: it would slide on by itself'
        freeze((forces, matrix))
        sliding = tuple(bool(one) for one in slides)
        estimate = partial(_estimated, shape, self._placed(here.s), self._first, matrix,
                           slides) if shape.converged else state.estimate
        return changed(
            shape, holds=self._placed(here.s), converged=shape.converged and not trouble,
            stability=min(shape.stability, lowest), iterations=shape.iterations + self._steps,
            state=changed(state, feed=Feed(forces, sliding, matrix, work, trouble),
                          kicks=state.kicks + self._kicks, estimate=estimate))


def _with_friction(matrix: Floats, slope: Floats, slip: Floats, moved: Floats) -> Floats:
    """Return the change (n,) of places that makes a quadratic model of E and friction least.

    The least of slope . change + change . matrix . change / 2 + slip . |moved + change|, by its
    signs: those of what slides, 0 of what sticks (a primal-dual active set; else each in turn).

    Shapes: matrix (n, n), positive definite, N/m; slope, slip (n,) N; moved (n,) m, since the step
    began.
    """
    stiff = np.diag(matrix)

    def shrunk(place: Floats, force: Floats) -> Floats:
        wanted = place - force / stiff
        result: Floats = np.sign(wanted) * np.maximum(np.abs(wanted) - slip / stiff, 0.0)
        return result

    place, signs = moved.copy(), np.sign(shrunk(moved, slope))
    for _ in range(_SIGNS):
        free = (signs != 0) | (slip == 0.0)
        change = -moved.copy()
        right = -(slope + slip * signs + matrix[:, ~free] @ change[~free])
        change[free] = np.linalg.solve(matrix[np.ix_(free, free)], right[free])
        place = np.where(free, moved + change, 0.0)
        after = np.sign(shrunk(place, slope + matrix @ change))
        after = np.where(free & (np.sign(place) == signs), signs, after)
        if np.array_equal(after, signs):
            return change
        signs = after
    place = moved.copy()
    for _ in range(_SWEEPS):
        for i in range(place.size):
            place[i] = shrunk(place, slope + matrix @ (place - moved))[i]
    return place - moved


def _stuck(holds: Holds) -> Holds:
    return tuple(hold.stuck for hold in holds)


def _symmetric(matrix: Floats) -> Floats:
    result: Floats = 0.5 * (matrix + matrix.T)
    return result


# ------------------------------------------------------------------------------------------------
# The slope of the energy, and meshes that go with the places.


def material_slope(shape: Shape) -> Floats:
    """Return (A,) the derivative of the energy by the place that each hold inside holds, N.

    With all nodes between the places beside it stretched evenly; nan for the tip. The Lagrangian's
    derivative with strains and forces of the holds as they are: what an element is longer by moves
    all beyond it along its tangent, and turns it by its strain.
    """
    mesh, s = shape.state.made_on, shape.s
    around, system = mesh.surroundings, mesh.free
    positions, frames = shape.positions - shape.gripper.position, shape.frames
    on_nodes = np.zeros((s.size, 6))
    on_nodes[:, :3] = -system.load.pull
    for hold, wrench in zip(shape.holds, shape.wrenches, strict=True):
        on_nodes[int(np.argmin(np.abs(s - place_of(hold, float(s[-1]))))) ] += wrench
    inside = np.zeros(s.size - 1)
    for contact in shape.contacts:  # at the same part of its element; that presses across the DLO
        e = min(int(np.searchsorted(s, contact.s, side='right')) - 1, s.size - 2)
        part = (contact.s - s[e]) / (s[e + 1] - s[e])
        inside[e] += part * float(contact.vector @ shape.frame_at(contact.s)[0][:, 0])
        arm = contact.position - shape.positions[e + 1]
        on_nodes[e + 1] += [*contact.vector, *np.cross(arm, contact.vector)]
        inside[e] -= float(contact.vector @ frames[e + 1, :, 0]) + float(
            np.cross(arm, contact.vector) @ (frames[e] @ shape.element_strains[e]))
    # forces beyond an element, and their moments about its end
    force = np.cumsum(on_nodes[::-1, :3], axis=0)[::-1]
    turn = np.cumsum((on_nodes[:, 3:] + np.cross(positions, on_nodes[:, :3]))[::-1],
                     axis=0)[::-1]
    moment = turn - np.cross(positions, force)
    along = np.einsum('ei,ei->e', force[1:], frames[1:, :, 0])
    bent = np.einsum('ei,eij,ej->e', moment[1:], frames[1:], shape.element_strains)
    by_length = -(along + bent + inside)

    def stored(nodes: Floats) -> float:
        strained = shape.element_strains - around.rod.mean_natural_strains(nodes)
        pulled = node_masses(around.rod, nodes)[:, None] * around.gravity + node_forces(
            around, nodes)
        elastic = 0.5 * np.diff(nodes) @ (around.rod.mean_stiffnesses(nodes) * strained**2).sum(1)
        return float(elastic - (pulled * positions).sum())

    fixed = np.union1d(around.breaks, [0.0, *places_of(shape.holds), float(s[-1])])
    slopes = np.full(len(shape.holds), np.nan)
    for k, hold in enumerate(shape.holds):
        if hold.s is None:
            continue
        at = int(np.searchsorted(fixed, hold.s))
        weight = np.interp(s, fixed, np.eye(fixed.size)[at])  # how far each node goes along
        step_ = _MESH_MOVED * float(s[-1])
        own = (stored(s + step_ * weight) - stored(s - step_ * weight)) / (2 * step_)
        slopes[k] = own + float(np.diff(weight) @ by_length)
    return slopes


def _estimated(shape: Shape, holds: Holds, first: Discretization, matrix: Floats,
               slides: Bools) -> float:
    """Return how far, in m, the nodes are from the true rod's, that of what is in rings included.

    On halved elements other places are in the rings, by how D answers there.
    """
    state, mesh = shape.state, shape.state.made_on
    before = state.before or mesh.start
    finer = halved(mesh, shape.gripper, shape.element_strains, before, shape.holds, state.culled)
    if finer is None:
        return np.inf
    index = np.array([k for k, hold in enumerate(holds) if hold.is_ring])
    if slides.any():
        off = (material_slope(finer) - material_slope(shape))[index][slides]
        block = _symmetric(matrix[np.ix_(slides, slides)])
        moved = list(holds)
        answer = np.linalg.lstsq(block, -off, rcond=None)[0]
        for k, by in zip(index[slides].tolist(), answer.tolist(), strict=True):
            s = moved[k].s
            assert s is not None
            moved[k] = moved[k].at_place(s + by)
        there = _stuck(tuple(moved))
        spans = spans_of(there, shape.gripper, float(shape.s[-1]))
        if any(span.length <= span.distance for span in spans):
            return np.inf
        finer = step(stretched(finer.state.made_on, finer.holds, there, first), shape.gripper,
                     changed(finer, holds=there), StepInputs(holds=there), finer.element_strains)
        if not finer.converged:
            return np.inf
    away = finer.positions_at(shape.s) - shape.positions
    return float(4 / 3 * np.linalg.norm(away, axis=1).max() + 1e-15 * shape.s.size * shape.s[-1])


def answers_at(shape: Shape, places: Sequence[float]) -> Floats:
    """Return (k, 6, 6 + 6 A) `Sensitivity.by_grips` at k places, m; the Shape may slide in rings.

    How a grip changes what holds a ring's place back is how the place changes the grip's wrench:
    both are one second derivative of the energy.
    """
    stuck = changed(shape, holds=_stuck(shape.holds), state=changed(shape.state, feed=None))
    sensitivity, feed = Sensitivity(stuck), shape.state.feed
    answers = np.array([sensitivity.by_grips(s) for s in places])
    if feed is None or not any(feed.slides):
        return answers
    index = [k for k, hold in enumerate(shape.holds) if hold.is_ring]
    slides, length = np.flatnonzero(feed.slides), float(shape.s[-1])
    frames = [stuck.frame_at(s) for s in places]
    fed = np.empty((len(places), 6, slides.size))
    pulls = np.empty((answers.shape[2], slides.size))
    for column, ring in enumerate(slides.tolist()):
        holds = list(stuck.holds)
        at = holds[index[ring]].s
        assert at is not None
        by = _DIFFERENCE * length
        holds[index[ring]] = shape.holds[index[ring]].at_place(at + by).stuck
        mesh = stretched(shape.state.made_on, stuck.holds, tuple(holds), shape.state.made_on)
        there = step(mesh, shape.gripper, changed(stuck, holds=tuple(holds)),
                     StepInputs(holds=tuple(holds)), shape.element_strains)
        for k, (s, (axes, x)) in enumerate(zip(places, frames, strict=True)):
            turned, moved = there.frame_at(s)
            fed[k, :3, column] = Rotation.from_matrix(turned @ axes.T).as_rotvec() / by
            fed[k, 3:, column] = (moved - x) / by
        more = np.vstack([there.gripper_wrench, there.wrenches]) - np.vstack(
            [shape.gripper_wrench, shape.wrenches])
        pulls[:, column] = more[:, [3, 4, 5, 0, 1, 2]].ravel() / by
    block = _symmetric(feed.stiffness[np.ix_(slides, slides)])
    result: Floats = answers - fed @ np.linalg.lstsq(block, pulls.T, rcond=None)[0]
    return result
