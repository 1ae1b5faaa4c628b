"""Many at once: shapes and plans by all cores of a machine, or of a cluster (extra `[cluster]`)."""

from dlo_planner.parallel.mapping import map, solve_many
from dlo_planner.parallel.shapes import Shapes

__all__ = ['Shapes', 'map', 'solve_many']
