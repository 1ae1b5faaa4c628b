# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a simulator returns is its own: no array of a Shape is one that the next step writes to."""

import numpy as np
import pytest

from dlo_planner import Box, DirectSimulator, FarEnd, Plane, Pose, Rod, Sphere
from dlo_planner.geometry.record import Record
from dlo_planner.model.value import Value

LEVEL = Pose.identity()
MOVED = Pose((0, 0.003, 0), LEVEL.quaternion)
ROD = Rod.circular(0.3, 0.004, 1200, 5e7, 0.4)
SOFT = Rod.circular(0.3, 0.002, 7850, 2e11, 0.3, yield_stress=3e8)
FAR = FarEnd(Pose.looking_along((0.25, 0, -0.03), (1, 0, 0)))
AROUND = {
    'free': (ROD, (), None),
    'ball': (ROD, (Sphere((0.18, 0, -0.05), 0.04),), None),
    'floor': (ROD, (Plane((0, 0, -0.03), (0, 0, 1), 0.3),), None),
    'box': (ROD, (Box(Pose((0.2, 0, -0.05), (0, 0, 0, 1)), (0.05, 0.2, 0.05), 0.3),), None),
    'held': (ROD, (), FAR),
    'held over a floor': (ROD, (Plane((0, 0, -0.04), (0, 0, 1), 0.3),), FAR),
    'yields': (SOFT, (Sphere((0.18, 0, -0.05), 0.04),), None)}


def arrays(content, seen):
    """Yield all arrays that can be reached from a content, meshes and functions left out."""
    if id(content) in seen:
        return
    seen[id(content)] = content
    if isinstance(content, np.ndarray):
        yield content
    elif isinstance(content, Record):
        for name in content.FIELDS:
            yield from arrays(getattr(content, name), seen)
    elif isinstance(content, tuple | list):
        for part in content:
            yield from arrays(part, seen)
    elif isinstance(content, Value):
        for name, part in content.__dict__.items():
            if name not in ('mesh', 'estimate', 'of'):
                yield from arrays(part, seen)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('name', AROUND)
def test_no_array_of_a_shape_is_an_array_of_its_mesh(name, basis):
    rod, obstacles, far_end = AROUND[name]
    direct = DirectSimulator(rod, n_elements=12, n_terms=4, basis=basis, obstacles=obstacles)
    shape = direct.solve(LEVEL, far_end=far_end)
    shape = direct.solve(MOVED, shape, far_end=far_end)
    working = [one for problem in (direct.mesh.free, direct.mesh.held, direct.mesh.full)
               for one in arrays(problem, {})]
    assert len(working) > 20
    owned = list(arrays(shape, {}))
    assert len(owned) > 8
    for one in owned:
        assert not any(one is other or np.shares_memory(one, other) for other in working)
