# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a simulator knows of the terms of the potential that depend on holds and on the past.

The kernels of a term are in `energy`; what a Discretization, a past and a Shape have to do with it
is a subclass of Part: how its Record is made, what it leaves to the next step, what it reports.
`memory.ACTING` lists them, with `contact.Touch`. Nothing else knows terms by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from dlo_planner.direct.mesh import mapped
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.energy.grip import GripConstraint, constraint_violation, holds, no_grip
from dlo_planner.energy.plastic import (
    PlasticSection,
    add_plastic,
    return_map,
    set_strains,
    yielding_layers,
    yields,
)
from dlo_planner.energy.problem import Configuration, Problem, tip_wrench
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.record import Record
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import shown
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.supports import FarEnd, distance, spans
from dlo_planner.model.value import freeze

if TYPE_CHECKING:
    from dlo_planner.direct.discretization import Discretization

Left: TypeAlias = Mapping[str, Any]  # arrays by name: what effects leave to the next step


class Held(NamedTuple):
    """Where a DLO is held: the gripper's position (3,) in m, if it matters; FarEnd or None."""

    origin: Floats | None = None
    far_end: FarEnd | None = None


class Solved(NamedTuple):
    """A step as a minimizer left it.

    Attributes
    ----------
    mesh : Discretization
    system : Problem
        With the multipliers as they are at the end.
    state : Configuration
        That of the kernels, nodes relative to the gripper.
    gripper : Pose
        Of the DLO's beginning.
    far_end : FarEnd or None
    left : Left
        What was left to the step.
    """

    mesh: Discretization
    system: Problem
    state: Configuration
    gripper: Pose
    far_end: FarEnd | None
    left: Left


class Part:
    """An effect as simulators know it; as written here, one that leaves and reports nothing.

    Attributes
    ----------
    name : str
        Its name in `energy.terms.TERMS`.
    of_rod : bool
        Whether what it leaves belongs to the rod, wherever that is taken; else to all that acts.
    lets_go : bool
        Whether it may let go of a DLO that differs a little, so that its shape is another one.
    stores : bool
        Whether it stores energy in the DLO where it acts, and moves the stress-free strains.
    rests : bool
        Whether it leaves and reports nothing new where it does not act, or its grip is free.
    """

    name: str = ''
    of_rod: bool = False
    lets_go: bool = False
    stores: bool = False
    rests: bool = False

    def acts(self, around: Surroundings) -> bool:
        """Whether a DLO in these Surroundings does not hang freely because of it."""
        return False

    def given(self, mesh: Discretization) -> Any:
        """Return what depends on neither grips nor past: the mesh keeps it (`mesh.given`)."""
        return None

    def record(self, mesh: Discretization, left: Left, held: Held) -> Record | None:
        """Return its Record where the DLO is held there, after what is left to it; or None."""
        raise NotImplementedError

    def changes(self, mesh: Discretization, held: Held) -> bool:
        """Whether its Record depends on what is left and how the DLO is held there."""
        return False

    def placed(self, mesh: Discretization, base: Floats, left: Left,
               held: Held) -> Problem | None:
        """Return the Problem in a gripper of rotation `base` (3, 3), if it alone changes; or None.

        None where there is no quicker way to it than by `record`.
        """
        return None

    def empty(self, mesh: Discretization, s: Floats) -> Left:
        """Return what it leaves where nothing has happened yet, on nodes `s` (N + 1,), m."""
        return {}

    def judged(self, left: Left, nodes: int) -> Left:
        """Return what a file says that it left on so many nodes; raise InvalidTask as `filed`."""
        return {}

    def resampled(self, left: Left, s: Floats, wanted: Floats) -> Left:
        """Return what it left on nodes `s` (N + 1,) as it is on nodes `wanted` (n + 1,), m."""
        return {}

    def fits(self, left: Left, start: Left) -> bool:
        """Whether what is left may be of a DLO whose beginning, without a past, is `start`."""
        return True

    def cleared(self, left: Left) -> Left:
        """Return what it left as if it had not acted."""
        return {}

    def idle(self, left: Left) -> bool:
        """Whether what it left has no say in the next step."""
        return True

    def lasts(self, left: Left) -> bool:
        """Whether it left anything for good."""
        return False

    def leaves(self, solved: Solved) -> Left:
        """Return what it leaves to the next step."""
        return {}

    def underway(self, solved: Solved) -> Left:
        """Return what it leaves to another part of the same step."""
        return {}

    def with_contacts(self, before: Left, after: Left) -> Left:
        """Return what it left before a step, with the forces after it."""
        return {}

    def reports(self, solved: Solved, left: Left) -> dict[str, Any]:
        """Return attributes of the Shape by name; `left` is what the step leaves."""
        return {}

    def constrains(self, system: Problem) -> bool:
        """Whether it constrains the DLO there."""
        return False

    def violation(self, solved: Solved) -> float:
        """Return by how much it is violated, m, besides `Minimum.constraint_violation`."""
        return 0.0

    def kept(self, solved: Solved) -> bool:
        """Whether its own limits are kept, besides that of all violations."""
        return True

    def stored(self, mesh: Discretization, left: Left, strains: Floats) -> float:
        """Return the energy in J that it stores at strains (N, 3), 1/m."""
        return 0.0

    def strains(self, mesh: Discretization, left: Left) -> Floats:
        """Return by how much it moves the stress-free strains (N, 3), 1/m."""
        return np.zeros_like(mesh.natural)


def filed(left: Left, name: str, shape: tuple[int, ...], *, kind: type = float,
          lowest: float = -np.inf, highest: float = np.inf) -> Any:
    """Return an array of what a file says was left, with numbers of a `kind`, float or int."""
    value = np.asarray(left.get(name, ()))
    if (name not in left or value.shape != shape
            or value.dtype.kind not in ('iu' if kind is int else 'iuf')
            or not np.isfinite(value).all() or (value < lowest).any() or (value > highest).any()):
        limits = '' if lowest == -np.inf else f' from {lowest:g} to {highest:g}'
        raise InvalidTask(f'past_{name} = {shown(value.tolist())}: expected finite '
                          f'{"integers" if kind is int else "numbers"} of shape {shape}{limits}')
    return value.astype(kind)


_FAR_BEYOND = 10.0  # yield limits: a section that is strained as far bears what it can
_ALONE = 5.0        # times as far as the elements beside it
_FEW = 5            # elements: too few to tell


class PermanentSet(Part):
    """Springs that yield, `energy.plastic`. They leave two things.

    set: (N, J) plastic strain of each spring, 1/m; (N, 0) if elastic
    lost: energy lost to plastic deformation so far, J
    """

    name = 'plastic'
    of_rod = True
    stores = True
    rests = True

    def acts(self, around: Surroundings) -> bool:
        """Whether the DLO yields anywhere."""
        return around.rod.yields

    def given(self, mesh: Discretization) -> PlasticSection:
        """Return the PlasticSection without a set."""
        layers: PlasticSection = yielding_layers(mesh.rod, mesh.bare.stiffness)
        return layers

    def record(self, mesh: Discretization, left: Left, held: Held) -> PlasticSection:
        """Return the PlasticSection, set as they are."""
        layers: PlasticSection = mesh.given(self.name)
        return layers._replace(set=left['set'].copy())

    def changes(self, mesh: Discretization, held: Held) -> bool:
        """Whether the DLO yields."""
        return mesh.yields

    def empty(self, mesh: Discretization, s: Floats) -> Left:
        """Return no set."""
        springs = mesh.given(self.name).set.shape[1] if mesh.yields else 0
        return {'set': np.zeros((s.size - 1, springs)), 'lost': np.array(0.0)}

    def judged(self, left: Left, nodes: int) -> Left:
        """Return the set of so many nodes less one, and what it cost."""
        springs = np.shape(left.get('set', ()))[1:]
        return {'set': filed(left, 'set', (nodes - 1, *(springs or (0,)))),
                'lost': filed(left, 'lost', (), lowest=0.0)}

    def resampled(self, left: Left, s: Floats, wanted: Floats) -> Left:
        """Return the set averaged over other elements."""
        return {'set': mapped(s, left['set'], wanted)}

    def fits(self, left: Left, start: Left) -> bool:
        """Whether there are as many springs."""
        return bool(left['set'].shape[1] == start['set'].shape[1])

    def idle(self, left: Left) -> bool:
        """Whether nothing is set, nor has been."""
        return not left['set'].any() and not left['lost']

    def lasts(self, left: Left) -> bool:
        """Whether anything is set."""
        return bool(left['set'].any())

    def leaves(self, solved: Solved) -> Left:
        """Return the set after the step, and what it cost."""
        system, left = solved.system, solved.left
        if not (solved.mesh.yields and yields(system.plastic)):
            return {'set': left['set'], 'lost': left['lost']}
        new, lost = return_map(system.lengths, solved.state.strains, system.natural, system.plastic)
        return {'set': new, 'lost': np.array(left['lost'] + lost)}

    def reports(self, solved: Solved, left: Left) -> dict[str, Any]:
        """Return the energy lost."""
        return {'dissipated': float(left['lost'])}

    def stored(self, mesh: Discretization, left: Left, strains: Floats) -> float:
        """Return the energy in the springs, which a step that has ended leaves no loss in."""
        system, layers = mesh.static, self.record(mesh, left, Held())
        return float(add_plastic(system.lengths, strains, system.natural, layers,
                                 np.zeros_like(strains)))

    def strains(self, mesh: Discretization, left: Left) -> Floats:
        """Return the strains at which the springs balance."""
        moved: Floats = set_strains(mesh.bare.stiffness, self.record(mesh, left, Held()))
        return moved


def hinge(rod: Rod, bent: Floats) -> tuple[int, float] | None:
    """Return the element that is a plastic hinge, and its strain in yield limits; None if none is.

    Without hardening a moment beyond what the section can bear bends one element alone, the sharper
    the shorter it is. An element that is bent or twisted far beyond its limit bears its limit
    moment to 0.3 %; if the next ones but one bear 8 % less, so the moment in it is beyond that.

    Shapes: bent (N, 3).
    """
    if not rod.yields or rod.hardening > 0 or len(bent) < _FEW:
        return None
    curved: Any = rod.yield_curvature or (np.inf, np.inf)  # a pair, whatever was given
    shares = np.abs(bent) / (rod.yield_torsion or np.inf, *curved)
    for share in (shares[:, 0], np.hypot(shares[:, 1], shares[:, 2])):
        at = int(share.argmax())
        beside = max(share[max(at - 2, 0):max(at - 1, 0)].max(initial=0.0),
                     share[at + 2:at + 3].max(initial=0.0))
        if share[at] > _FAR_BEYOND and share[at] > _ALONE * beside:
            return at, float(share[at])
    return None


_KEPT = 1e-9       # of the length: by how much a grip may be missed at the end
_SLACK = 1e-3      # of the slack: the same, as the DLO pulls the tighter the less there is
_EXACT = 1e-4      # of the slack: what is aimed at
_LEAST = 1e-10     # of the length: slack that is looked at
_IN_VAIN = 30      # Newton steps towards what is out of reach
_NOTHING = np.zeros(6)
_NO_FORCES = np.zeros(0)
freeze((_NOTHING, _NO_FORCES))


class FarHold(Part):
    """The grip of the far end, `energy.grip`. It leaves one thing.

    hold: (K,) forces of the grip, N
    """

    name = 'hold'
    rests = True

    def record(self, mesh: Discretization, left: Left, held: Held) -> GripConstraint:
        """Return the GripConstraint, with the forces that are left of as many motions."""
        free = free_end(mesh)
        if held.far_end is None or held.origin is None:
            return free
        end, rows = held.far_end, held.far_end.held
        rows[:, :3] *= mesh.lever
        known = left['hold']
        force = known.copy() if known.shape == (len(rows),) else np.zeros(len(rows))
        return free._replace(
            target=end.pose.position - held.origin, axes=np.array(end.pose.rotation, order='C'),
            share=np.array(end.share), rows=rows, multiplier=force)

    def changes(self, mesh: Discretization, held: Held) -> bool:
        """Whether the far end is held."""
        return held.origin is not None and held.far_end is not None

    def empty(self, mesh: Discretization, s: Floats) -> Left:
        """Return no forces."""
        return {'hold': np.zeros(0)}

    def judged(self, left: Left, nodes: int) -> Left:
        """Return the forces, up to six."""
        count = np.size(left.get('hold', ()))
        return {'hold': filed(left, 'hold', (min(count, 6),))}

    def cleared(self, left: Left) -> Left:
        """Return no forces."""
        return {'hold': np.zeros(0)}

    def leaves(self, solved: Solved) -> Left:
        """Return the forces."""
        if solved.far_end is None:
            return {'hold': _NO_FORCES}
        hold = solved.system.hold
        return {'hold': np.zeros(0) if hold is None else hold.multiplier}

    underway = leaves

    def with_contacts(self, before: Left, after: Left) -> Left:
        """Return the forces after the step."""
        return {'hold': after['hold']}

    def reports(self, solved: Solved, left: Left) -> dict[str, Any]:
        """Return force and moment on the DLO at its far end, about that end."""
        free = solved.far_end is None
        return {'far_wrench': _NOTHING if free else -tip_wrench(solved.state)}

    def constrains(self, system: Problem) -> bool:
        """Whether the far end is held."""
        return holds(system.hold)

    def kept(self, solved: Solved) -> bool:
        """Whether the end is where it is held: the slack of a taut DLO decides on its tension."""
        if solved.far_end is None:
            return True
        state = solved.state
        missed = constraint_violation(solved.system.hold, state.rotations[-1].copy(),
                                      state.positions[-1].copy())
        return bool(missed <= reach_of(solved.mesh, np.array(distance(solved.far_end,
                                                                      solved.gripper))))


def reach_of(mesh: Discretization, spanned: Floats) -> Floats:
    """Return by how much a grip may be missed at distances (n,) that are spanned, m.

    Below zero where that is out of reach.
    """
    length, loaded = float(mesh.s[-1]), mesh.loaded
    slack = _SLACK * (length - spanned) if loaded else np.inf
    return np.where(spans(spanned, length, loaded), np.minimum(_KEPT * length, slack), -1.0)


class Limits(NamedTuple):
    """Of a search: Newton steps, and by what part of the length constraints may be violated."""

    steps: int
    exact: float


def limits_of(mesh: Discretization, gripper: Pose, far_end: FarEnd | None,
              usual: Limits) -> Limits:
    """Return the Limits of a search, `usual` where the far end is free.

    The less slack there is, the more its tension depends on where the end is. What is out of reach
    is given up soon.
    """
    if far_end is None:
        return usual
    length, (steps, exact) = float(mesh.s[-1]), usual
    spanned = distance(far_end, gripper)
    if not spans(spanned, length, mesh.loaded):
        steps = _IN_VAIN
    if mesh.loaded:
        exact = min(exact, _EXACT * max(1.0 - spanned / length, _LEAST))
    return Limits(steps, exact)


def free_end(mesh: Discretization) -> GripConstraint:
    """Return the GripConstraint of a free end."""
    return no_grip(mesh.hold_spring, mesh.hold_spring * mesh.lever**2)
