"""Dead loads: gravity on the DLO's own mass and on the masses it carries, Eq. 2a."""

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.kernels import kernel
from dlo_planner.model.checks import vector


def node_masses(rod, s):
    """Return the masses (n,) in kg that stand for the rod on nodes at arc lengths `s` (n,).

    Each element's own mass goes half and half to its two nodes; a point mass goes to the two
    nodes around it in inverse proportion to its distances.
    """
    half = 0.5 * rod.masses_per_length(0.5 * (s[1:] + s[:-1])) * np.diff(s)
    masses = np.zeros(s.size)
    masses[:-1] += half
    masses[1:] += half
    masses[-1] += rod.tip_mass
    for where, mass in rod.point_masses:
        e = min(max(np.searchsorted(s, where, side='right') - 1, 0), s.size - 2)
        share = (where - s[e]) / (s[e + 1] - s[e])
        masses[e] += (1 - share) * mass
        masses[e + 1] += share * mass
    return masses


def distributed(load, s):
    """Return the forces (n, 3) in N on nodes at `s` (n,) of a force per length.

    Args:
        load: (3,) N/m, world axes, a callable of s (m) returning that, or None

    Raises:
        InvalidTask: the callable returns something else
    """
    forces = np.zeros((s.size, 3))
    if load is None:
        return forces
    middle = 0.5 * (s[1:] + s[:-1])
    density = np.array([vector(f'load({v:g})', load(v), 3, InvalidTask) if callable(load) else load
                        for v in middle])
    half = 0.5 * np.diff(s)[:, None] * density
    forces[:-1] += half
    forces[1:] += half
    return forces


@kernel
def dead_load(pull, positions):
    """Return V = sum of pull . x and sum |pull . x|, its rounding scale, both in J.

    Args:
        pull: (N + 1, 3) dV/dx = - force on each node, N
        positions: (N + 1, 3) relative to the gripper, m
    """
    energy = 0.0
    size = 0.0
    for k in range(pull.shape[0]):
        part = (pull[k, 0] * positions[k, 0] + pull[k, 1] * positions[k, 1]
                + pull[k, 2] * positions[k, 2])
        energy += part
        size += abs(part)
    return energy, size
