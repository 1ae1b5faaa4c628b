# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One method for each task with a contact, as `shorthands` has them for threading."""

from numpy.typing import ArrayLike

from dlo_planner.inverse.shorthands import Shorthands
from dlo_planner.inverse.tasks import HoldContact, SlideContact
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import OnProgress


class ContactShorthands(Shorthands):
    """The methods of an InverseSimulator that are short for a task with a contact."""

    def hold_contact(self, contact: Pose, s: float, *, condition: str | None = 'least_energy',
                     forces: ArrayLike | None = None, min_force: float | None = None,
                     start: Pose | None = None, linear_speed: float = 0.1,
                     angular_speed: float = 0.5, progress: OnProgress = None,
                     deadline: float | None = None) -> Plan:
        """Plan how to hold the DLO in contact with an obstacle (paper, section 5.3, Fig. 16).

        Arc length, place and direction at the contact leave the force of contact free: a family of
        gripper poses, found without a search. Its admissible parts are intervals of the force: the
        shape is stable, with the contact as a constraint, by 0.02 at least, it is in no obstacle,
        and it keeps this simulator's demands. The choice from them is the minimum to 0.1 %, and
        the direct simulation confirms it. The DLO beyond the contact has the shape that it takes
        when it is released from its natural one.

        Parameters
        ----------
        contact : Pose
            Pose on the surface of one of the simulator's obstacles: x axis = direction of the DLO,
            z axis = outward normal. A DLO that is not round lies there with the axes (t, n, b) of
            its material frame along the contact's: a strip whose width is along n lies flat.
        s : float
            Arc length of the contact, m.
        condition : str or None, optional
            Which one of the family: 'least_energy' (bending), 'least_force' (`min_force`, where
            that can be held), 'least_motion' (from `start`), 'largest_clearance' (from the other
            obstacles; without any, the least energy). If None, a motion through the interval that
            has the least energy, in order of the force, its steps below 0.12 (rad plus parts of
            the length).
        forces : array_like, shape (n,), optional
            Forces in N: only these are examined. If None, all.
        min_force : float, optional
            Least force of the contact, N: what presses less loses it where friction, or the DLO in
            motion, lifts it. If None, a tenth of weight + EI / L^2. With 0 a thousandth of that
            is enough.
        start : Pose, optional
            Pose of the gripper before.
        linear_speed, angular_speed, progress, deadline : optional
            As for `thread`.

        Returns
        -------
        Plan

        Raises
        ------
        InvalidTask
            An argument makes no sense, or the contact is not on a surface.
        Infeasible
            No force is admissible. The constraint is the demand that the best one breaks
            ('contact_force': it is below `min_force`), or 'contact': the amount is how far, in m,
            the DLO would be in an obstacle, or off the best of these shapes.
        """
        return self._plan(HoldContact(contact, s, condition, forces, min_force), start, None,
                          self._with(linear_speed, angular_speed, deadline), progress)

    def slide_contact(self, contact: Pose, lengths: ArrayLike, *, condition: str = 'least_motion',
                      forces: ArrayLike | None = None, min_force: float | None = None,
                      start: Pose | None = None, mode: str = 'aligned', linear_speed: float = 0.1,
                      angular_speed: float = 0.5, progress: OnProgress = None,
                      deadline: float | None = None) -> Plan:
        """Plan how to draw the DLO over an obstacle, with its direction kept (Fig. 15) or not.

        Parameters
        ----------
        lengths : array_like, shape (n,)
            Arc lengths between gripper and contact, m, one after the other.
        contact : Pose
            As for `hold_contact`.
        condition : str, optional
            As for `hold_contact`; 'least_motion' is from one waypoint to the next, the first one
            has the least energy if there is no `start`. The others choose the first waypoint; each
            further one is the local minimum that is nearest to the one before.
        forces, min_force, start : optional
            As for `hold_contact`.
        mode : str, optional
            'aligned': the DLO keeps its place and direction at the contact; 'straight': the gripper
            keeps its orientation and goes straight from the first waypoint towards the contact, or
            away from it (footnote 19 of the paper). Place and direction of the contact then drift:
            `Plan.misalignment` and `Plan.position_error` say by how much. `condition` and `forces`
            choose the first waypoint.
        linear_speed, angular_speed, progress, deadline : optional
            As for `thread`.

        Returns
        -------
        Plan

        Raises
        ------
        InvalidTask
            An argument makes no sense; the message names it.
        Infeasible
            As for `hold_contact`; or 'continuity': no admissible shapes lead from one waypoint to
            the next, the amount is the gripper's leap (rad plus parts of the length), with
            'straight' how far the DLO falls, in m. Or 'contact': how far the arc length that
            touches is from the requested one, in m. Carries the plan up to it.
        """
        return self._plan(SlideContact(contact, lengths, condition, forces, mode, min_force), start,
                          None, self._with(linear_speed, angular_speed, deadline), progress)
