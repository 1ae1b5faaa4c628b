# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One contact at one arc length: which forces keep everything, and what is wrong where none does.

The curve of shapes is `inverse.solvers.contact.family`'s; here are the plan's demands on it, and
its confirmation by the direct simulation.
"""

from dataclasses import dataclass

import numpy as np

from dlo_planner.direct.accuracy import step
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.solvers.contact.family import STABLE, ContactFamily
from dlo_planner.inverse.solvers.contact.intervals import intervals
from dlo_planner.model.pose import Pose
from dlo_planner.plan.builder import PlanRequirements
from dlo_planner.plan.continuity import apart
from dlo_planner.plan.waypoint import waypoint_at

LEAST, MOST = 1e-3, 30.0  # forces looked at, as parts of the natural ones
_ELEMENTS = 64            # of the mesh on which a force is chosen
_MOST_ELEMENTS = 4096
HARDLY_STABLE = 1e-3     # what counts as stable where nothing is more stable
_SAME_FORCE, _SAME_PLACE = 0.1, 1e-3  # relative; of the length: what counts as confirmed
_NEAR = 0.02              # of the length: contacts that are counted as the one


@dataclass(frozen=True)
class Contacting:
    """One contact task at one arc length.

    Attributes
    ----------
    simulator : DirectSimulator
    family : ContactFamily
        A quick one, on a coarse mesh.
    brief : PlanRequirements
    """

    simulator: DirectSimulator
    family: ContactFamily
    contact: Pose
    brief: PlanRequirements

    @classmethod
    def at(cls, simulator, contact, s, brief):
        """Return the task of keeping `contact` at `s`."""
        own = simulator.mesh
        elements = min(max(own.s.size - 1, 8), 2 * _ELEMENTS)
        return cls(simulator, ContactFamily(simulator, contact, s, brief.progress.check, elements),
                   contact, brief)

    @property
    def s(self):
        """Arc length of the contact, m."""
        return self.family.s

    def merit(self, force):
        """Return a number that is positive where this force keeps everything."""
        merit = self.family.merit(force)
        if merit <= 0:
            return merit
        broken = self.brief.violation(self.waypoint(self.family.shape(force)))
        return merit if broken is None else -broken[1]

    def waypoint(self, shape):
        """Return the Waypoint of a Shape."""
        return waypoint_at(shape, self.family.place, self.s, self.family.frame[:, 0])

    def parts(self, forces, draft):
        """Return the admissible intervals as lists of forces, ascending; raise Infeasible if none.

        Parameters
        ----------
        forces
            (n,) forces to be examined, N, each an interval of its own. If None, all.
        """
        family = self.family
        for _ in range(2):
            if forces is not None:
                found = [[float(force)] for force in forces if self.merit(float(force)) > 0]
            else:
                least, most = LEAST * family.scale[0], MOST * family.scale[1]
                found = intervals(self.merit, least, most)
            best = family.most_stable()
            if found or best is None or not HARDLY_STABLE < best.stability <= STABLE:
                break
            family.stable = 0.5 * best.stability
        if not found:
            raise self._refusal(draft)
        return found

    def confirmed(self, force):
        """Return the Shape that the direct simulator finds with this force, None if another."""
        guess = self._guess(force)
        shape = self.simulator.solve(guess.gripper, guess)
        length = shape.s[-1]
        found = sum(one.force for one in shape.contacts if one.obstacle == self.family.obstacle
                    and abs(one.s - self.s) < _NEAR * length)
        off = np.linalg.norm(shape.frame_at(self.s)[1] - self.family.place)
        same = abs(found - force) <= _SAME_FORCE * force and off <= _SAME_PLACE * length
        return shape if shape.converged and same else None

    def _guess(self, force):
        """Return the Shape with this force on a mesh that is as good as the simulator's."""
        own, accuracy = self.simulator.mesh, self.simulator.accuracy
        shape = self.family.shape(force)
        elements = shape.s.size - 1
        wanted = own.s.size - 1
        samples = np.linspace(0, shape.s[-1], 9)
        while True:
            if accuracy is not None:
                wanted = min(2 * elements, _MOST_ELEMENTS)
            if wanted == elements:
                return shape
            family = ContactFamily(self.simulator, self.contact, self.s,
                                   self.brief.progress.check, wanted)
            finer = family.shape(force)
            moved = np.abs(finer.positions_at(samples) - shape.positions_at(samples)).max()
            shape, elements = finer, wanted
            if accuracy is not None and moved < 0.2 * accuracy:
                return shape

    def _refusal(self, draft):
        """Return Infeasible: what is wrong with the best of the shapes that were looked at."""
        family = self.family
        good = [force for force in family.known if family.merit(force) > 0]
        if good:
            broken = [self.brief.violation(self.waypoint(family.shape(force))) for force in good]
            constraint, amount, why = min(broken, key=lambda what: what[1])
            return draft.refusal(constraint, amount, f'none of {len(good)} contact forces will '
                                 f'do; with the best of them, {why}')
        looked = (f'no contact force of {min(family.known):.3g} to {max(family.known):.3g} N keeps '
                  f'the DLO touching at s = {self.s:g} m')
        best = family.most_stable()
        if best is None:
            least = min(family.shape(force).violation for force in family.known)
            return draft.refusal('contact', least, f'{looked}: with each of them it would be in an '
                                 f'obstacle, by {least:.3g} m at least')
        found, _ = step(best.state.mesh, best.gripper, best, None, None)
        return self.left(draft, best, found, f'{looked} in a stable shape: the best one has a '
                         f'stability of {best.stability:.3g}')

    def unconfirmed(self, draft, parts):
        """Return Infeasible because the direct simulation confirms no force of these intervals."""
        best = max((self.family.shape(force) for part in parts for force in part),
                   key=lambda shape: shape.stability)
        return self.left(draft, best, self.simulator.solve(best.gripper, best),
                         'the direct simulation with its own discretization confirms none of the '
                         'contact forces that should do; a finer one may')

    def left(self, draft, shape, found, why):
        """Return Infeasible because the DLO is `found` elsewhere; the amount is how far, in m."""
        amount = apart(found, shape)
        return draft.refusal('contact', amount, f'{why}; the DLO would be off by {amount:.3g} m')
