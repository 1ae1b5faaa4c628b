# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that is grasped somewhere along its length: two free ends.

From the gripper it is two DLOs, one to each end. The one to the beginning runs against the arc
length: its frame is (-t, n, -b), its strains are (torsion, -curvature about n, curvature about b).
The two do not touch each other; nothing else is neglected.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from dlo_planner.direct.boundary_motion import poses
from dlo_planner.direct.shape import Shape, State
from dlo_planner.direct.simulator import DirectSimulator, known_options
from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, number, shown
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import BACK, Rod
from dlo_planner.model.supports import STANDARD_GRAVITY, Surroundings
from dlo_planner.model.value import Value, brief, figures, put
from dlo_planner.progress import OnProgress, Progress, interrupted_by

_TURNED = np.diag([-1.0, 1.0, -1.0])  # of frames


class GraspedInside(Value):
    """Predicts the shape of a DLO held at arc length `at`, with two free ends.

    Parameters
    ----------
    rod : Rod
        The whole rod.
    at : float
        Where the gripper holds it, m, 0 < at < length; x axis of the gripper = tangent there,
        towards growing s.
    options
        As for `DirectSimulator`, for each part.

    Raises
    ------
    InvalidTask, InvalidRod
        An argument makes no sense.
    """

    _PARTS = ('rod', 'at', '_parts')

    rod: Rod
    at: float
    _parts: tuple[DirectSimulator, ...]

    def __init__(self, rod: Rod, at: float, **options: Any) -> None:
        instance('rod', rod, Rod)
        at = number('at', at, above=0, below=rod.length)
        whole = Surroundings(rod, np.array(STANDARD_GRAVITY), options.pop('load', None),
                             point_loads=options.pop('point_loads', ()))
        parts = [whole.part(at, direction) for direction in (-1, 1)]
        put(self, rod=rod, at=at, _parts=tuple(
            DirectSimulator(part.rod, **known_options(options), load=part.load,
                            point_loads=part.point_loads) for part in parts))

    def __repr__(self) -> str:
        return brief(self, f'at {self.at:.4g} m', figures(self.rod))

    def solve(self, gripper: Pose, initial: Shape | None = None, *,
              deadline: float | None = None) -> Shape:
        """Return the stable Shape, s from end to end; arguments as `DirectSimulator.solve`."""
        before = (None, None) if initial is None else _parts_of(initial)
        with interrupted_by(Progress(deadline=deadline).check):
            back, on = (part.solve(pose, shape) for part, pose, shape in
                        zip(self._parts, _both(gripper), before, strict=True))
        return _joined(gripper, back, on)

    def track(self, grippers: Iterable[Pose], progress: OnProgress = None,
              initial: Shape | None = None, *, deadline: float | None = None) -> list[Shape]:
        """Return the shapes along a slow motion; arguments as `DirectSimulator.track`."""
        grippers = poses(grippers)
        steps = Progress(progress, deadline)
        before: tuple[Shape | None, ...] = (None, None)
        if initial is not None:
            before = _parts_of(initial)
        joined = []
        for gripper in grippers:
            with interrupted_by(steps.check):
                back, on = (part.track([pose], initial=shape)[0] for part, pose, shape in
                            zip(self._parts, _both(gripper), before, strict=True))
            joined.append(_joined(gripper, back, on))
            before = tuple(shape if shape.converged else last
                           for shape, last in zip((back, on), before, strict=True))
            steps.done(len(joined), len(grippers))
        return joined


def _both(gripper: Pose) -> tuple[Pose, Pose]:
    instance('gripper', gripper, Pose)
    return Pose.from_rotation(gripper.position, gripper.rotation @ _TURNED), gripper


def _parts_of(shape: object) -> tuple[Shape, ...]:
    if not isinstance(shape, Shape) or shape.parts is None:
        raise InvalidTask(f'initial = {shown(shape)}: expected a Shape of a DLO grasped inside')
    return shape.parts


def _joined(gripper: Pose, back: Shape, on: Shape) -> Shape:
    """Return the Shape of both parts as one, s = 0 at the free end of `back`."""
    at = back.s[-1]
    contacts = [replace(contact, s=at - contact.s) for contact in reversed(back.contacts)]
    contacts += [replace(contact, s=at + contact.s) for contact in on.contacts]
    return replace(
        on, gripper=gripper, s=np.concatenate([at - back.s[:0:-1], at + on.s]),
        positions=np.vstack([back.positions[:0:-1], on.positions]),
        frames=np.concatenate([back.frames[:0:-1] @ _TURNED, on.frames]),
        element_strains=np.vstack([back.element_strains[::-1] * BACK, on.element_strains]),
        energy=back.energy + on.energy,
        elastic_energy=back.elastic_energy + on.elastic_energy,
        gripper_wrench=back.gripper_wrench + on.gripper_wrench,
        residual=max(back.residual, on.residual), stability=min(back.stability, on.stability),
        iterations=max(back.iterations, on.iterations),
        converged=back.converged and on.converged, jumped=back.jumped or on.jumped,
        contacts=tuple(contacts), violation=max(back.violation, on.violation),
        dissipated=back.dissipated + on.dissipated, parts=(back, on),
        state=State(estimate=partial(_larger_estimate, back, on)))


def _larger_estimate(back: Shape, on: Shape) -> float:
    return max(back.error_estimate, on.error_estimate)
