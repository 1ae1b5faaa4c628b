# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random DLOs: how large is the error estimate beside the figures that spare its computation?

python test/random_estimates.py [how many] [seed]

`truncation_error` of DLOs that hang freely, are held at both ends, touch a plane or a bar;
`minimize.expected_error` on meshes where the error is below 2e-4 of the length, without and with
point masses and loads.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent)]
from random_rods import random_rod  # noqa: E402

from dlo_planner import Capsule, DirectSimulator, Plane, PointLoad, Pose, Rod  # noqa: E402
from dlo_planner.geometry.basis import truncation_error  # noqa: E402
from dlo_planner.minimize.expected_error import foresee  # noqa: E402

MESHES = ({}, {'basis': 'local', 'n_elements': 64}, {'n_elements': 64, 'n_terms': 10})
SOFT = 2000.0          # w L^3 / EI
STABLE = 0.1           # what is less stable is not judged,
COARSE, RESOLVED = 0.02, 2e-4  # nor is what is off by more of the length
LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))


def to_truncation(shape):
    """Return the error estimate of a Shape over its truncation, nan where that is not judged."""
    mesh = shape.state.made_on
    if not mesh.told_by_truncation or not shape.converged or shape.stability < STABLE:
        return np.nan
    system = mesh.static
    told = truncation_error(system.lengths, shape.element_strains, system.natural, system.scale,
                            system.basis)
    return shape.error_estimate / told if shape.error_estimate < COARSE else np.nan


def hanging(rng, index):
    """Return the ratio of a DLO that hangs freely."""
    rod, gripper = random_rod(rng, SOFT)
    return to_truncation(DirectSimulator(rod, **MESHES[index % 3]).solve(gripper))


def held(rng, index):
    """Return the ratio of a DLO whose far end is clamped, too."""
    rod, _ = random_rod(rng, SOFT)
    way = Pose(LEVEL.position + rng.uniform(0.5, 0.9) * np.array([1, 0, 0])
               + rng.normal(0, 0.1, 3), (0, 0, 0, 1))
    return to_truncation(DirectSimulator(rod, **MESHES[index % 3]).solve(LEVEL, far_end=way))


def touching(rng, index):
    """Return the ratio of a DLO that lies on a floor or over a bar, nan if it does not touch."""
    load = 10 ** rng.uniform(0, np.log10(SOFT))
    rod = Rod(1.0, load / 9.81, 1.0, rng.uniform(0.3, 1.5), radius=3e-3)
    drop, x = rng.uniform(0.02, 0.3), rng.uniform(0.2, 0.7)
    below = (Plane((0, 0, 1 - drop), (0, 0, 1)) if index % 2 else
             Capsule((x, -0.5, 0.95 - drop), (x, 0.5, 0.95 - drop), 0.05))
    shape = DirectSimulator(rod, obstacles=[below], **MESHES[index % 3]).solve(LEVEL)
    return to_truncation(shape) if shape.contacts else np.nan


def resolved(rng, index, weights=False):
    """Return the error estimate of a DLO over what is expected, on a mesh that resolves it."""
    rod, gripper = random_rod(rng, 5000.0)
    points, nodes = (), []
    if weights:
        heavy = rod.mass_per_length * rod.length
        nodes = rng.uniform(0.2, 1, 2)
        rod = replace(rod, point_masses=[(nodes[0], heavy * rng.uniform(0, 1))])
        points = [PointLoad(force=rng.normal(0, heavy * 3, 3), s=nodes[1])]
    simulator = DirectSimulator(rod, basis='local', accuracy=10 ** rng.uniform(-5, -4),
                                point_loads=points)
    shape = simulator.solve(gripper)
    spread = -rod.mass_per_length * simulator.gravity
    expected, *_ = foresee(shape.state.made_on.static, gripper.rotation, shape.element_strains,
                           spread)
    judged = (shape.converged and shape.stability >= STABLE and expected < RESOLVED
              and np.isin(nodes, shape.s).all())  # of what acts inside elements it does not tell
    return shape.error_estimate / expected if judged else np.nan


def main():
    """Print the least and the largest ratios of each kind."""
    given = [int(value) for value in sys.argv[1:]]
    number, seed = (given + [300, 0][len(given):])[:2]
    kinds = {'truncation, hanging': hanging, 'truncation, held': held,
             'truncation, touching': touching, 'expected': resolved,
             'expected, with points': lambda rng, k: resolved(rng, k, weights=True)}
    for name, ratio in kinds.items():
        rng = np.random.default_rng(seed)
        found = np.array([ratio(rng, index) for index in range(number)])
        found = found[np.isfinite(found)]
        print(f'{name}: {found.size} of {number} judged, estimate {found.min():.2f} to '
              f'{found.max():.2f} times', flush=True)


if __name__ == '__main__':
    main()
