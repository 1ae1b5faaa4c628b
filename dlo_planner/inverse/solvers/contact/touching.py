# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One contact at one arc length: which forces keep all demands, and why none does.

`inverse.solvers.contact.family` has the curve of shapes; this file has the plan's demands on it and
its confirmation by the direct simulation.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.step import step
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.solvers.contact.family import STABLE, ContactFamily
from dlo_planner.inverse.solvers.contact.intervals import intervals
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.plan.builder import PlanBuilder, PlanRequirements
from dlo_planner.plan.continuity import apart
from dlo_planner.plan.waypoint import Waypoint, waypoint_at

LEAST, MOST = 1e-3, 30.0  # forces looked at, as parts of the natural ones
PRESSED = 0.1             # the same: the least one of a plan, where a task states none
_ELEMENTS = 64            # of the mesh on which a force is chosen
_MOST_ELEMENTS = 4096
HARDLY_STABLE = 1e-3     # what counts as stable where nothing is more stable
_SAME_FORCE, _SAME_PLACE = 0.1, 1e-3  # relative; of the length: what counts as confirmed
_NEAR = 0.02              # of the length: contacts that are counted as the one


@dataclass(frozen=True)
class ContactProblem:
    """One contact task at one arc length.

    Attributes
    ----------
    simulator : DirectSimulator
    family : ContactFamily
        A quick one, on a coarse mesh.
    contact : Pose
        Pose on the obstacle's surface: x axis along the DLO, z axis outwards.
    demands : PlanRequirements
        What the plan has to keep, the least force of the contact among it.
    """

    simulator: DirectSimulator
    family: ContactFamily
    contact: Pose
    demands: PlanRequirements

    @classmethod
    def at(cls, simulator: DirectSimulator, contact: Pose, s: float,
           demands: PlanRequirements, min_force: float | None = None) -> Self:
        """Return the problem of keeping `contact` at the arc length `s`, m."""
        family = _family(simulator, contact, s, demands)
        least = PRESSED * family.scale[0] if min_force is None else min_force
        return cls(simulator, family, contact,
                   replace(demands, min_force=least, pressed=family.obstacle))

    def moved(self, s: float) -> Self:
        """Return the same problem at another arc length, m."""
        return replace(self, family=_family(self.simulator, self.contact, s, self.demands))

    @property
    def s(self) -> float:
        """Arc length of the contact, m."""
        return self.family.s

    def merit(self, force: float) -> float:
        """Return a number that is positive if this force keeps all demands."""
        merit = self.family.merit(force)
        if merit <= 0:
            return merit
        broken = self.demands.violation(self.waypoint(self.family.shape(force)))
        return merit if broken is None else -broken[1]

    def waypoint(self, shape: Shape) -> Waypoint:
        """Return the Waypoint of a Shape."""
        return waypoint_at(shape, self.family.place, self.s, self.family.frame[:, 0])

    def parts(self, forces: Floats | None, builder: PlanBuilder) -> list[list[float]]:
        """Return the admissible intervals as lists of forces, ascending; raise Infeasible if none.

        Shapes: forces (n,).
        """
        family = self.family
        for _ in range(2):
            if forces is not None:
                admissible = [[float(force)] for force in forces if self.merit(float(force)) > 0]
            else:
                least, most = LEAST * family.scale[0], MOST * family.scale[1]
                admissible = intervals(self.merit, least, most)
            best = family.most_stable()
            if admissible or best is None or not HARDLY_STABLE < best.stability <= STABLE:
                break
            family.stable = 0.5 * best.stability
        if not admissible:
            raise self._refusal(builder)
        return admissible

    def confirmed(self, force: float) -> Shape | None:
        """Return the Shape if the direct simulator finds it with this force, else None."""
        guess = self._guess(force)
        shape = self.simulator.solve(guess.gripper, guess)
        length = shape.s[-1]
        reached = sum(one.force for one in shape.contacts if one.obstacle == self.family.obstacle
                      and abs(one.s - self.s) < _NEAR * length)
        off = np.linalg.norm(shape.frame_at(self.s)[1] - self.family.place)
        same = abs(reached - force) <= _SAME_FORCE * force and off <= _SAME_PLACE * length
        kept = shape.converged and same and self.demands.violation(self.waypoint(shape)) is None
        return shape if kept else None

    def _guess(self, force: float) -> Shape:
        """Return the Shape with this force on a mesh as fine as the simulator's."""
        own, accuracy = self.simulator.mesh, self.simulator.accuracy
        shape = self.family.shape(force)
        elements = shape.s.size - 1
        finer_elements = own.s.size - 1
        samples = np.linspace(0, shape.s[-1], 9)
        while True:
            if accuracy is not None:
                finer_elements = min(2 * elements, _MOST_ELEMENTS)
            if finer_elements == elements:
                return shape
            family = ContactFamily(self.simulator, self.contact, self.s,
                                   self.demands.progress.check, finer_elements)
            finer = family.shape(force)
            moved = np.abs(finer.positions_at(samples) - shape.positions_at(samples)).max()
            shape, elements = finer, finer_elements
            if accuracy is not None and moved < 0.2 * accuracy:
                return shape

    def _refusal(self, builder: PlanBuilder) -> Infeasible:
        """Return Infeasible, with the reason against the best of the examined shapes."""
        family = self.family
        good = [force for force in family.known if family.merit(force) > 0]
        if good:
            violations = (self.demands.violation(self.waypoint(family.shape(force)))
                          for force in good)
            constraint, amount, why = min((one for one in violations if one is not None),
                                          key=lambda one: one[1])
            return builder.refusal(constraint, amount, f'none of {len(good)} contact forces is '
                                   f'admissible; with the best of them, {why}')
        looked = (f'no contact force of {min(family.known):.3g} to {max(family.known):.3g} N keeps '
                  f'the DLO touching at s = {self.s:g} m')
        best = family.most_stable()
        if best is None:
            least = min(family.shape(force).violation for force in family.known)
            return builder.refusal('contact', least, f'{looked}: with each of them it would be in '
                                   f'an obstacle, by {least:.3g} m at least')
        settled, _ = step(best.state.made_on, best.gripper, best)
        return self.left(builder, best, settled, f'{looked} in a stable shape: the best one has a '
                         f'stability of {best.stability:.3g}')

    def unconfirmed(self, builder: PlanBuilder, parts: list[list[float]]) -> Infeasible:
        """Return Infeasible because the direct simulation confirms no force of these intervals."""
        best = max((self.family.shape(force) for part in parts for force in part),
                   key=lambda shape: shape.stability)
        return self.left(builder, best, self.simulator.solve(best.gripper, best),
                         'the direct simulation with its own discretization confirms none of the '
                         'admissible contact forces; a finer one may')

    def left(self, builder: PlanBuilder, shape: Shape, reached: Shape, why: str) -> Infeasible:
        """Return Infeasible because the DLO is `reached` elsewhere; the amount is how far, in m."""
        amount = apart(reached, shape)
        return builder.refusal('contact', amount, f'{why}; the DLO would be off by {amount:.3g} m')


def _family(simulator: DirectSimulator, contact: Pose, s: float,
            demands: PlanRequirements) -> ContactFamily:
    elements = min(max(simulator.mesh.s.size - 1, 8), 2 * _ELEMENTS)
    return ContactFamily(simulator, contact, s, demands.progress.check, elements)
