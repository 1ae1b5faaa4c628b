# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A cord in motion, released from where it begins; its stretch is that at rest.

A beginning that is held like a ball joint is made of one more element, so short that it moves
nothing and so soft that it holds nothing.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.cosserat.cord import Cord, settled
from benchmarks.cosserat.stretch import Stretch
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.varying import stepwise

_HINGE = 1e-6       # of the length
_SOFT = 1e-3, 1e-5  # moment of a hinge per rad: of EI / L, and of the weight times L at least
_STEPS = 800        # in the slowest vibration of a hanging cord, about


def swung(cord: Cord, times: Floats) -> tuple[Floats, Floats]:
    """Return positions (T, n + 1, 3) and directors (T, n, 3) at even times.

    Raises
    ------
    FloatingPointError
        The motion could not go on.
    NotImplementedError
        Its last end is held.
    """
    if cord.far_grip is not None:
        raise NotImplementedError('a moving rod whose last end is held: not modeled')
    stretch = settled(cord)[1]
    if len(stretch.strains) == 1:
        stretch = Stretch.along(np.linspace(0, cord.length, cord.n + 1), np.zeros(cord.n))
    gripper, strains = _begin(cord)
    mesh = stretch.stretched
    own = cord.rod(Stretch(stretch.free, mesh, stretch.strains))
    values = {'mass': _on(own.mass_per_length, mesh), 'bend': _on(own.bending_stiffness, mesh),
              'twist': _on(own.torsional_stiffness, mesh)}
    if cord.grip == 'pinned':
        hinge = _HINGE * mesh[-1]
        weight = cord.density * cord.area * cord.length * np.linalg.norm(cord.gravity)
        soft = hinge * max(_SOFT[0] * values['bend'][0] / mesh[-1], _SOFT[1] * weight * mesh[-1])
        mesh = np.concatenate([[0.0], hinge + mesh])
        values = {name: np.concatenate([[row[0] if name == 'mass' else soft], row])
                  for name, row in values.items()}
        strains = np.concatenate([np.zeros((1, 3)), strains])
    shapes = _simulated(cord, mesh, values, gripper, strains, times)
    skipped = len(mesh) - cord.n - 1
    positions = np.array([shape.positions[skipped:] for shape in shapes])
    frames = np.array([shape.frames[skipped:] for shape in shapes])
    return positions, _middle(frames[:, :-1, :, 1] + frames[:, 1:, :, 1], positions)


def _simulated(cord: Cord, mesh: Floats, values: Mapping[str, Any], gripper: Pose, strains: Floats,
               times: Floats) -> tuple[Shape, ...]:
    """Return the Shapes at all times of a cord that is let go with given strains (n, 3)."""
    values = dict(values)
    values['mass'], points = _even_masses(mesh, values['mass'], len(mesh) - 1 - cord.n)
    parts = {name: stepwise(mesh, row) for name, row in values.items()}
    rod = Rod(mesh[-1], parts['mass'], parts['bend'], parts['twist'], radius=cord.radius,
              point_masses=points)
    bent = Rod(mesh[-1], parts['mass'], parts['bend'], parts['twist'], radius=cord.radius,
               natural_curvature=stepwise(mesh, strains[:, 1:]),
               natural_twist=stepwise(mesh, strains[:, 0]))
    options: dict[str, Any] = {'basis': 'local', 'n_elements': len(mesh) - 1}
    start = DirectSimulator(bent, gravity=(0, 0, 0), **options).solve(gripper)
    simulator = DirectSimulator(rod, gravity=cord.gravity, **options)
    frames, span = len(times) - 1, float(times[-1] - times[0])
    longest = 2.6 * np.sqrt(cord.length / max(float(np.linalg.norm(cord.gravity)), 1e-3)) / _STEPS
    finer = max(1, int(np.ceil(span / frames / longest)))
    motion = simulator.simulate([gripper] * (frames * finer + 1), span / (frames * finer),
                                initial=start, tolerance=np.inf)
    if not motion.converged:
        raise FloatingPointError(f'{motion.status}: {motion.message}')
    return motion.shapes[::finer]


def _begin(cord: Cord) -> tuple[Pose, Floats]:
    """Return the Pose and the strains (n, 3) with which a cord of even nodes begins."""
    tangents = np.gradient(cord.nodes, axis=0, edge_order=2)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    n = cord.directors[0] - (cord.directors[0] @ tangents[0]) * tangents[0]
    n /= np.linalg.norm(n)
    frames = [np.column_stack([tangents[0], n, np.cross(tangents[0], n)])]
    strains = []
    for k, (one, other) in enumerate(zip(tangents, tangents[1:], strict=False)):
        axis = np.cross(one, other)
        size = np.linalg.norm(axis)
        turn = axis * (np.arctan2(size, one @ other) / size if size > 0 else 1.0)
        h = np.linalg.norm(cord.nodes[k + 1] - cord.nodes[k])
        strains.append(frames[-1].T @ turn / h)
        frames.append(Rotation.from_rotvec(turn).as_matrix() @ frames[-1])
    return Pose.from_rotation(cord.nodes[0], frames[0]), np.array(strains)


def _even_masses(mesh: Floats, density: Floats, skipped: int
                 ) -> tuple[Floats, tuple[tuple[float, float], ...]]:
    """Return masses per length (n,) and point masses that inertia feels as if they were spread.

    Halves of the elements' masses on their nodes are the trapezoidal rule: the moment of inertia
    comes out too large by (h / L)^2 / 2 of it. Gregory's first correction takes a sixth of what
    the end nodes have to those beside them. A Rod's masses per length make halves, so all have five
    sixths of their mass, and the nodes the rest as point masses.

    Parameters
    ----------
    mesh, density : ndarray
        Arc lengths (n + 1,) in m; mass per length (n,) of the elements in kg/m.
    skipped : int
        Number of first elements that are left as they are.
    """
    own = np.diff(mesh)[skipped:] * density[skipped:]
    if len(own) < 2:
        return density, ()
    halves = 0.5 * (np.append(own, 0.0) + np.append(0.0, own))
    more = halves / 6
    more[[0, -1]] = 0.0
    more[1] += halves[0] / 6
    more[-2] += halves[-1] / 6
    reduced = np.append(density[:skipped], 5 / 6 * density[skipped:])
    return reduced, tuple((float(s), float(m)) for s, m in zip(
        mesh[skipped + 1:-1], more[1:-1], strict=True))


def _on(value: Any, mesh: Floats) -> Floats:
    """Return what a number or a function of s is on the elements of a mesh (n,)."""
    middles = 0.5 * (mesh[1:] + mesh[:-1])
    return np.array([value(s) if callable(value) else np.ravel(value)[0] for s in middles])


def _middle(directors: Floats, positions: Floats) -> Floats:
    """Return directors (T, n, 3) as unit vectors across the elements between positions."""
    along = np.diff(positions, axis=1)
    along /= np.linalg.norm(along, axis=2)[..., None]
    directors = directors - np.sum(directors * along, axis=2)[..., None] * along
    result: Floats = directors / np.linalg.norm(directors, axis=2)[..., None]
    return result
