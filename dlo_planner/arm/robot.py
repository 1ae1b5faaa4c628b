# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A robot arm: its joints, where its tool link is, and how near its links come to each other."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from numpy.typing import ArrayLike

from dlo_planner.arm.chain import Chain, chain_of
from dlo_planner.arm.self_collision import SelfCollision
from dlo_planner.arm.urdf import parsed
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, items, number, row, shown
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import FrozenDict, Value, brief, put


@dataclass(frozen=True, eq=False, repr=False)
class Arm(Value):
    """A robot that carries the gripper; joints that are not its own stay where they are.

    Attributes
    ----------
    urdf : str
        Text of the robot's URDF.
    tool_link : str
        Link whose frame is the tool frame.
    joints : tuple of str
        Names of those that move, in the order of all arrays; empty: all that move the tool.
    fixed : dict
        rad or m, where other joints stand; those not named stand at 0, or where they follow another
        one.
    base : Pose
        Pose of the URDF's root link in the world.
    packages : tuple of str
        Folders in which the packages of meshes are (`package://`).
    srdf : str or None
        Text of the SRDF, which says what pairs of links are not looked at. If None, pairs that a
        joint links, and those that touch with all joints at 0, or at the limit next to it.
    self_clearance : float
        Self clearance in m, by which links have to stay clear of each other.

    Raises
    ------
    InvalidTask
        Naming the argument; or Pinocchio is not installed.
    """

    urdf: str
    tool_link: str
    joints: tuple[str, ...] = ()
    fixed: Mapping[str, float] = field(default_factory=FrozenDict)
    base: Pose = field(default_factory=Pose.identity)
    packages: tuple[str, ...] = ()
    srdf: str | None = None
    self_clearance: float = 0.0

    def __post_init__(self) -> None:
        instance('urdf', self.urdf, str)
        instance('tool_link', self.tool_link, str)
        instance('base', self.base, Pose)
        instance('fixed', self.fixed, Mapping)
        if self.srdf is not None:
            parsed('srdf', self.srdf)
        put(self, joints=items('joints', self.joints, str),
            packages=items('packages', self.packages, str),
            self_clearance=number('self_clearance', self.self_clearance, minimum=0),
            fixed=FrozenDict((name, number(f'fixed[{shown(name)}]', value))
                             for name, value in self.fixed.items()))
        put(self, joints=self.chain.names)  # builds it, which judges the rest
        super().__post_init__()

    def __repr__(self) -> str:
        return brief(self, self.tool_link, f'{len(self.joints)} joints')

    @property
    def lower(self) -> Floats:
        """(m,) lower limits of the joints, rad or m; -inf for one that turns for ever."""
        return self.chain.lower

    @property
    def upper(self) -> Floats:
        """(m,) upper limits of the joints, rad or m; inf for one that turns for ever."""
        return self.chain.upper

    @property
    def speeds(self) -> Floats:
        """(m,) largest speeds of the joints, rad/s or m/s."""
        return self.chain.speeds

    @property
    def carriers(self) -> tuple[str, ...]:
        """Joints that move the tool too, but are not the arm's: they stand as `fixed` says."""
        return self.chain.carriers

    @property
    def units(self) -> list[str]:
        """M units of the joints' positions, 'rad' or 'm'."""
        return ['rad' if turning else 'm' for turning in self.chain.turning]

    def pose(self, positions: ArrayLike) -> Pose:
        """Return the Pose of the tool link in the world at joint positions (m,), rad or m.

        Raises
        ------
        InvalidTask
            Not m finite numbers.
        """
        place, turn = self.chain.placement(self.checked('positions', positions))
        return self.base.compose(Pose.from_rotation(place, turn))

    def checked(self, name: str, positions: ArrayLike) -> Floats:
        """Return joint positions (m,) as a new array, or raise InvalidTask."""
        count = len(self.joints)
        return row(name, positions, least=count, most=count, minimum=-1e6, maximum=1e6)

    @cached_property
    def chain(self) -> Chain:
        """The joints' kinematics."""
        return chain_of(self.urdf, self.tool_link, self.joints, self.fixed)

    @cached_property
    def collision(self) -> SelfCollision:
        """The pairs of links that have to stay clear of each other."""
        return SelfCollision(self.chain, self.urdf, self.packages, self.srdf, self.self_clearance)
