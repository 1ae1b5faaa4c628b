"""Where the gripper may be: a cell is not empty."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dlo_planner.energy.distance import build_scene, signed_distance
from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import array, instance, items, number
from dlo_planner.model.obstacles import OBSTACLES
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, put

_SPACING, _MOST_PARTS = 5e-3, 200  # m, between places of the gripper that are looked at


@dataclass(frozen=True, eq=False, repr=False)
class Workspace(Value):
    """A box that the gripper stays inside, and bodies that it stays outside.

    Attributes:
        lower, upper: (3,) m, opposite corners of the box, world axes; infinite: no limit
        keep_out: Plane, Sphere, Capsule, Box, Sheet, in any number
        gripper_radius: m, of the sphere about the gripper's origin that stands for the gripper

    Raises:
        InvalidTask: naming the argument
    """

    lower: np.ndarray = (-np.inf,) * 3
    upper: np.ndarray = (np.inf,) * 3
    keep_out: tuple = ()
    gripper_radius: float = 0.0

    def __post_init__(self):
        put(self, **{name: array(f'Workspace.{name}', getattr(self, name), (3,), finite=False)
                     for name in ('lower', 'upper')})
        if not (self.lower < self.upper).all():
            raise InvalidTask(f'Workspace.upper = {self.upper.tolist()}: expected more than lower '
                              f'= {self.lower.tolist()}')
        put(self, keep_out=items('Workspace.keep_out', self.keep_out, OBSTACLES),
            gripper_radius=number('Workspace.gripper_radius', self.gripper_radius, minimum=0))
        super().__post_init__()

    @cached_property
    def _scene(self):
        return build_scene(self.keep_out, self.gripper_radius)

    def least_room(self, before, gripper) -> tuple[str, float]:
        """Return (name, m) of the limit that is nearest on a gripper's straight way, < 0 beyond.

        Args:
            before: Pose where it comes from, None: it is there
            gripper: Pose where it goes
        """
        instance('before', before, Pose, optional=True)
        way = [instance('gripper', gripper, Pose).position]
        if before is not None and self.keep_out:  # the box is convex: its ends tell
            apart = np.linalg.norm(gripper.position - before.position)
            parts = int(min(np.ceil(apart / _SPACING), _MOST_PARTS))
            way += [before.position + k / parts * (gripper.position - before.position)
                    for k in range(1, parts)]
        return min((room for position in way for room in self._rooms(position)),
                   key=lambda room: room[1], default=('', np.inf))

    def _rooms(self, position):
        """Yield (name, m) for each limit."""
        for name, rooms in (('lower', position - self.lower), ('upper', self.upper - position)):
            for axis, room in zip('xyz', rooms, strict=True):
                if room < np.inf:
                    yield f'workspace.{name}.{axis}', float(room) - self.gripper_radius
        normal, bend = np.empty(3), np.empty((3, 3))
        for o in range(self._scene.kind.size):
            room = signed_distance(self._scene, o, np.array(position), normal, bend)
            yield (f'workspace.keep_out[{self._scene.source[o]}]',
                   float(room) - self.gripper_radius)
