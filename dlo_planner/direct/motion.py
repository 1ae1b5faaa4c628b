"""The answer of a dynamic simulation."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.direct.shape import Shape


@dataclass(frozen=True, eq=False)
class Motion:
    """A DLO in motion at n instants.

    Attributes:
        times: (n,) s
        shapes: n Shape; residual and stability are those of the step's minimisation,
            gripper_wrench includes inertia and damping, error_estimate is infinite (not known)
        velocities: (n, N_L + 1, 3) of the nodes, m/s, world axes
        kinetic_energy, potential_energy: (n,) J; gravity's zero at the world's origin
    """

    times: np.ndarray
    shapes: list[Shape]
    velocities: np.ndarray
    kinetic_energy: np.ndarray
    potential_energy: np.ndarray

    def __len__(self):
        return len(self.shapes)

    @property
    def energy(self):
        """(n,) kinetic and potential energy, J."""
        return self.kinetic_energy + self.potential_energy

    @property
    def converged(self):
        """Whether every step was solved."""
        return all(shape.converged for shape in self.shapes)
