"""The outside of a DLO: what contact and clearance need to know of a Rod."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.model.value import Value

_BESIDE = 1e-7  # of an element: so near to its ends the radius is asked for


@dataclass(frozen=True, eq=False, repr=False)
class Surface(Value):
    """How far the outside of a DLO is from its axis.

    Attributes:
        radius: m, the largest
        half: (half_n, half_b) of a rectangular section, m; None: round
        rod: Rod whose radius varies along s, or None
    """

    radius: float = 0.0
    half: tuple[float, float] | None = None
    rod: object = None

    @classmethod
    def of(cls, rod) -> 'Surface':
        """Return the Surface of a Rod.

        A rectangular `Rod.section` counts where `Rod.radius` is its bounding half size; another
        radius is that of a round cover.
        """
        if rod.radius is None:
            return cls()
        section = rod.section
        if not isinstance(rod.radius, float):
            return cls(float(rod.radii(np.linspace(0, rod.length, 1025)).max()), None, rod)
        if (section is not None and section.kind == 'rectangular'
                and rod.radius == max(section.half_n, section.half_b)):
            return cls(rod.radius, (section.half_n, section.half_b))
        return cls(rod.radius)

    @property
    def bound(self) -> float:
        """The largest distance of the outside from the axis, m."""
        return self.radius if self.half is None else float(np.hypot(*self.half))

    @property
    def least(self) -> float:
        """The smallest distance of the outside from the axis, m."""
        return self.radius if self.half is None else min(self.half)

    def radii(self, s) -> np.ndarray:
        """Return (N, 2) the radius at both ends of the N elements of a mesh `s` (N + 1,), m.

        Where the radius jumps at a node, both values are known: each is that of its own element.
        (0, 2) where the radius is the same everywhere.
        """
        if self.rod is None:
            return np.zeros((0, 2))
        beside = _BESIDE * np.diff(s)
        return np.column_stack([self.rod.radii(s[:-1] + beside), self.rod.radii(s[1:] - beside)])
