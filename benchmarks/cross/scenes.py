# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What both engines simulate: a rod, the way of its gripper over time, obstacles.

Motions begin with the DLO hanging at rest. In a contact scene the gripper moves slowly to its last
pose, and the shape that is compared is the one at rest there.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner import Capsule, CutOut, Plane, Pose, Rod, Sheet, Sphere

STATIC, CONTACT, MOTION = 'static', 'contact', 'motion'
Way = Callable[[float], Pose]
Obstacle = Plane | Sphere | Capsule | Sheet


@dataclass(frozen=True)
class Scene:
    """A scene; `way` gives the gripper at a time in s, from 0 to `seconds`.

    Attributes:
        interval: s, between the poses that `track` and `simulate` get
    """

    name: str
    kind: str
    rod: Rod
    way: Way
    seconds: float = 0.0
    interval: float = 0.01
    obstacles: tuple[Obstacle, ...] = ()

    @property
    def grippers(self) -> list[Pose]:
        """The poses at all intervals."""
        count = round(self.seconds / self.interval)
        return [self.way(k * self.interval) for k in range(count + 1)]


def copper(diameter: float, damping: float = 0.0) -> Rod:
    """Return a copper wire of 1 m."""
    return Rod.circular(1.0, diameter, 8960.0, 110e9, 0.34, damping=damping)


def still(pose: Pose) -> Way:
    """Return the way of a gripper that does not move."""
    return lambda _: pose


def straight(begin: tuple[float, float, float], end: tuple[float, float, float]) -> Way:
    """Return the straight way of a level gripper, in 1 s."""
    def way(t: float) -> Pose:
        return Pose((1 - t) * np.array(begin) + t * np.array(end), (0, 0, 0, 1))
    return way


def _tilted(t: float) -> Pose:
    """Benchmark C: turned by 180 degrees and back in 2 s."""
    return Pose((0, 0, 1), Rotation.from_euler('y', -np.pi / 2 * (1 - np.cos(np.pi * t))).as_quat())


def _swept(t: float) -> Pose:
    """Go 0.3 m aside in 0.6 s, and turn about the vertical and about the tangent meanwhile."""
    x = min(t / 0.6, 1.0)
    part = x**3 * (10 - 15 * x + 6 * x**2)
    return Pose((0, 0.3 * part, 1), Rotation.from_euler('ZX', (0.8 * part, 1.0 * part)).as_quat())


def _free() -> list[Scene]:
    level, aslant = Pose((0, 0, 1), (0, 0, 0, 1)), Pose((0.1, 0.2, 1.0), (0.3, -0.4, 0.2, 0.8))
    strip = Rod(1.0, 0.08, (0.02, 0.2), 0.02)
    curly = Rod(1.3, 0.2, (0.3, 0.8), 0.4, natural_curvature=(1.0, -0.5), natural_twist=2.0,
                tip_mass=0.1, point_masses=((0.65, 0.2),))
    return [Scene('soft wire, w L^3/EI = 100', STATIC, Rod(1.0, 1.0 / 9.81, 0.01, 0.0075),
                  still(level)),
            Scene('copper wire, 1 mm (benchmark A)', STATIC, copper(1e-3), still(level)),
            Scene('stiff wire, w L^3/EI = 1', STATIC, Rod(1.0, 1.0 / 9.81, 1.0, 0.75),
                  still(level)),
            Scene('strip, EI_b = 10 EI_n, aslant', STATIC, strip, still(aslant)),
            Scene('natural curvature, twist and masses', STATIC, curly, still(aslant))]


def _touching() -> list[Scene]:
    wire = copper(1.5e-3)
    bar = Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02)
    ball = Sphere((0.25, 0.02, 0.7), 0.1)
    floor = Plane((0, 0, 0), (0, 0, 1))
    passed = Pose.looking_along((0.3735, 0, 0.8571), (0.8168, 0, -0.5770))
    # a round hole has 24 sides in MuJoCo, a DLO that moves aside would rest in one of its corners
    holes = (('round', CutOut(passed, radius=0.02), (0, 0, 0.93)),
             ('rectangular', CutOut(passed, width=0.06, height=0.04), (0, 0.02, 0.93)))
    return [Scene('wire on a bar', CONTACT, wire, straight((0, 0, 0.95), (0, 0, 0.65)), 1.0, 0.05,
                  (bar,)),
            Scene('wire on a plane', CONTACT, wire, straight((0, 0, 0.7), (0, 0, 0.2)), 1.0, 0.05,
                  (floor,)),
            Scene('wire on a sphere, beside its top', CONTACT, wire,
                  straight((0, 0, 0.95), (0, 0, 0.84)), 1.0, 0.05, (ball,)),
            *(Scene(f'wire in a {name} hole', CONTACT, wire, straight((0, 0, 1.0), end), 1.0,
                    0.05, (Sheet.around(hole),)) for name, hole, end in holes)]


def _moving() -> list[Scene]:
    return [Scene('benchmark C in motion, to 1.5 s', MOTION, copper(1e-3, damping=2e-3), _tilted,
                  1.5),
            Scene('wire swept aside and turned', MOTION, copper(1.5e-3, damping=2e-3), _swept, 1.5)]


def scenes() -> list[Scene]:
    """Return all scenes."""
    return [*_free(), *_touching(), *_moving()]
