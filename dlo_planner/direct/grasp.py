"""A DLO that is grasped somewhere along its length: two free ends.

From the gripper it is two DLOs, one to each end. The one to the beginning runs against the arc
length: its frame is (-t, n, -b), its strains are (torsion, -curvature about n, curvature about b).
The two do not touch each other; nothing else is neglected.
"""

from dataclasses import replace

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import number
from dlo_planner.model.part import BACK, part_of_rod
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod

_TURNED = np.diag([-1.0, 1.0, -1.0])  # of frames


class GraspedInside:
    """Predicts the shape of a DLO held at arc length `at`, with two free ends.

    Args:
        rod: the whole Rod
        at: where the gripper holds it, m, 0 < at < length; x axis of the gripper = tangent there,
            towards growing s
        options: as for `DirectSimulator`, for each part

    Raises:
        InvalidTask, InvalidRod: an argument makes no sense
    """

    def __init__(self, rod, at, **options):
        if not isinstance(rod, Rod):
            raise InvalidTask(f'rod = {rod!r}: expected a Rod')
        at = number('at', at, above=0, maximum=rod.length)
        if at == rod.length:
            raise InvalidTask(f'at = {at:g}: expected less than the length {rod.length:g} m')
        if callable(options.get('load')):
            load = options.pop('load')
            loads = (lambda s: load(at - s)), (lambda s: load(at + s))
        else:
            loads = (options.pop('load', None),) * 2
        self.rod, self.at = rod, at
        self._parts = tuple(DirectSimulator(part, load=load, **options) for part, load in
                            zip((part_of_rod(rod, at, -1), part_of_rod(rod, at, 1)), loads,
                                strict=True))

    def solve(self, gripper, initial=None):
        """Return the stable Shape, s from end to end; arguments as `DirectSimulator.solve`."""
        before = (None, None) if initial is None else _parts_of(initial)
        back, on = (part.solve(pose, shape) for part, pose, shape in
                    zip(self._parts, _both(gripper), before, strict=True))
        return _joined(gripper, back, on)

    def track(self, grippers, progress=None, initial=None):
        """Return the shapes along a slow motion; arguments as `DirectSimulator.track`."""
        grippers = list(grippers)
        before = (None, None) if initial is None else _parts_of(initial)
        ways = zip(*(_both(gripper) for gripper in grippers), strict=True)
        shapes = [part.track(way, initial=shape) for part, way, shape in
                  zip(self._parts, ways, before, strict=True)]
        joined = [_joined(*both) for both in zip(grippers, *shapes, strict=True)]
        if progress is not None:
            progress(len(joined), len(grippers))
        return joined


def _both(gripper):
    if not isinstance(gripper, Pose):
        raise InvalidTask(f'gripper = {gripper!r}: expected a Pose')
    return Pose.from_rotation(gripper.position, gripper.rotation @ _TURNED), gripper


def _parts_of(shape):
    if not isinstance(shape, Shape) or shape.parts is None:
        raise InvalidTask(f'initial = {shape!r}: expected a Shape of a DLO grasped inside')
    return shape.parts


def _joined(gripper, back, on):
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
        _estimate=lambda: max(back.error_estimate, on.error_estimate), _discretisation=None,
        _history=None, _before=None)
