"""What a DLO carries from one step to the next: its permanent set and its contacts."""

from dataclasses import dataclass, field, replace

import numpy as np

from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.model.value import Value, freeze


@dataclass(frozen=True, eq=False, repr=False)
class History(Value):
    """The past of a Shape, as far as the next step depends on it.

    Attributes:
        s: (N + 1,) the mesh it is given on, m
        set: (N, J) plastic strain of each spring, 1/m, see `energy.plastic`; (N, 0) if elastic
        lost: energy lost to plastic deformation so far, J
        node_force: (M, N + 1) force of each obstacle on each node, N
        points: dict of arrays, contacts inside elements and points of friction, world frame
        hold: (K,) forces of the far end's grip, N, see `energy.hold`
        positions: (N + 1, 3) of the nodes, m, from which friction counts
        of: Surroundings in which it happened; None: not known, as of a shape from a file
    """

    s: np.ndarray
    set: np.ndarray
    lost: float
    node_force: np.ndarray
    points: dict
    hold: np.ndarray
    positions: np.ndarray
    of: Surroundings | None = field(default=None, compare=False)

    def __post_init__(self):
        for array in (self.s, self.set, self.node_force, self.hold, self.positions):
            array.flags.writeable = False
        if self.points is not NO_POINTS:
            freeze(self.points)

    @classmethod
    def none(cls, s, springs, obstacles, of=None):
        """Return the past of a DLO that has none."""
        n = s.size - 1
        return cls(s, np.zeros((n, springs)), 0.0, np.zeros((obstacles, n + 1)), NO_POINTS,
                   np.zeros(0), np.zeros((0, 3)), of)

    def on(self, s):
        """Return the same past on another mesh `s` (n + 1,); forces of contact are forgotten."""
        if s is self.s or np.array_equal(s, self.s):
            return self
        positions = self.positions
        if len(positions):
            positions = np.column_stack([np.interp(s, self.s, column) for column in positions.T])
        moved = replace(self, s=s, set=mapped(self.s, self.set, s), positions=positions)
        return moved.without_contacts(self.node_force.shape[0])

    def holding(self, later):
        """Return the same past with the forces of contacts and grips of a `later` one."""
        return replace(self, node_force=later.node_force, points=later.points, hold=later.hold)

    def without_contacts(self, obstacles):
        """Return the same past without forces of contact, for a number of obstacles."""
        return replace(self, points=NO_POINTS, node_force=np.zeros((obstacles, self.s.size)))

    def set_alone(self, obstacles):
        """Return the permanent set without contacts, grips and the way so far."""
        return replace(self.without_contacts(obstacles), hold=np.zeros(0),
                       positions=np.zeros((0, 3)))


NO_POINTS = {'element': np.zeros(0, dtype=np.int64), 'obstacle': np.zeros(0, dtype=np.int64),
             'multiplier': np.zeros(0), 'fraction': np.zeros(0), 'anchor': np.zeros((0, 3)),
             'normal': np.zeros((0, 3))}
freeze(NO_POINTS)


def mapped(s, values, wanted):
    """Return (n, k): `values` (N, k), constant on the elements of `s`, averaged over `wanted`'s."""
    total = np.vstack([np.zeros(values.shape[1]),
                       np.cumsum(values * np.diff(s)[:, None], axis=0)])
    at_nodes = np.column_stack([np.interp(wanted, s, column) for column in total.T]
                               or [np.zeros((wanted.size, 0))])
    return np.diff(at_nodes, axis=0) / np.diff(wanted)[:, None]
