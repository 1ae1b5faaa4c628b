"""The answer of a dynamic simulation."""

from dataclasses import dataclass
from os import PathLike

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.storage import load, pack, save, unpack
from dlo_planner.model.checks import items, results
from dlo_planner.model.value import Value, brief, put

_ARRAYS = ('times', 'velocities', 'kinetic_energy', 'potential_energy')


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Value):
    """A DLO in motion at n instants.

    Attributes:
        times: (n,) s
        shapes: n Shape; residual and stability are those of the step's minimisation,
            gripper_wrench includes inertia and damping, error_estimate is infinite (not known)
        velocities: (n, N_L + 1, 3) of the nodes, m/s, world axes
        kinetic_energy, potential_energy: (n,) J; gravity's zero at the world's origin
    """

    times: np.ndarray
    shapes: tuple[Shape, ...]
    velocities: np.ndarray
    kinetic_energy: np.ndarray
    potential_energy: np.ndarray

    def __post_init__(self):
        shapes = items('Motion.shapes', self.shapes, Shape)
        put(self, shapes=shapes, velocities=results('Motion.velocities', self.velocities,
                                                    (len(shapes), None, 3)),
            **{name: results(f'Motion.{name}', getattr(self, name), (len(shapes),))
               for name in ('times', 'kinetic_energy', 'potential_energy')})
        super().__post_init__()

    def __repr__(self):
        return brief(self, f'{len(self)} instants',
                     f'{self.times[-1]:.4g} s' if len(self) else '',
                     'converged' if self.converged else 'not converged')

    def save(self, path: str | PathLike) -> None:
        """Write the motion as npz: everything but the rod and its surroundings."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        for k, shape in enumerate(self.shapes):
            arrays |= pack(shape, f'{k}/')
        save(path, arrays)

    @classmethod
    def load(cls, path: str | PathLike) -> 'Motion':
        """Return the Motion saved at `path`.

        Raises:
            InvalidTask: not such a file
        """
        return load(path, cls._read)

    @classmethod
    def _read(cls, arrays):
        shapes = []
        for k in range(len(arrays['times'])):
            mark = f'{k}/'
            own = {key[len(mark):]: value for key, value in arrays.items()
                   if key.startswith(mark)}
            shapes.append(unpack(Shape, own))
        return cls(shapes=shapes, **{name: arrays[name] for name in _ARRAYS})

    def __len__(self):
        return len(self.shapes)

    @property
    def energy(self) -> np.ndarray:
        """(n,) kinetic and potential energy, J."""
        return self.kinetic_energy + self.potential_energy

    @property
    def converged(self) -> bool:
        """Whether every step was solved."""
        return all(shape.converged for shape in self.shapes)
