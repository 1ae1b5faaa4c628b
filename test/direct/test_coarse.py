# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""First shapes in two grips are sought on a coarse mesh: they are those of the mesh itself."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, FarEnd, Hold, Pose, Rod
from dlo_planner.direct import equilibrium, placement

COUNT = 16


@pytest.fixture
def tried(monkeypatch):
    """Yield a list of whether each first shape was found on a coarse mesh."""
    found = []

    def looked_at(*arguments):
        made = coarsely(*arguments)
        found.append(made is not None)
        return made

    coarsely = placement.coarsely
    monkeypatch.setattr(placement, 'coarsely', looked_at)
    return found


def given(rng, k):
    """Return a simulator of a soft to stiff DLO, a gripper and a far end."""
    mass = 10 ** rng.uniform(-2, -0.8)
    bending = 9.81 * mass * 10 ** rng.uniform(-3, 1)
    rod = Rod(1.0, mass, bending, rng.uniform(0.3, 1.5) * bending, radius=3e-3)
    direct = DirectSimulator(rod, n_elements=64, basis='local') if k % 2 else DirectSimulator(rod)
    gripper = Pose.looking_along(rng.uniform(-0.1, 0.1, 3), (1, *rng.uniform(-1, 1, 2)))
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    end = Pose.looking_along(gripper.position + rng.uniform(0.2, 0.9) * way,
                             rng.normal(size=3) + 2 * way)
    return direct, gripper, FarEnd(end, ('clamped', 'pinned', 'aligned', 'sleeve')[k % 4])


def test_they_are_those_of_the_way_on_the_mesh_itself(tried, monkeypatch):
    rng = np.random.default_rng(3)
    cases = [given(rng, k) for k in range(COUNT)]
    found = [direct.solve(gripper, far_end=end) for direct, gripper, end in cases]
    assert all(tried) and len(tried) == COUNT
    monkeypatch.setattr(placement, 'coarsely', lambda *_: None)
    for (direct, gripper, end), shape in zip(cases, found, strict=True):
        known = direct.solve(gripper, far_end=end)
        assert shape.converged and known.converged
        np.testing.assert_allclose(shape.positions_at(known.s), known.positions, atol=1e-6)


def test_nothing_but_the_way_is_sought_on_the_coarse_mesh(monkeypatch):
    sought = []

    def counted(mesh, *arguments):
        sought.append(mesh.s.size - 1)
        return solution(mesh, *arguments)

    solution = equilibrium.solution
    monkeypatch.setattr(equilibrium, 'solution', counted)
    rng = np.random.default_rng(5)
    for k in range(COUNT):
        direct, gripper, end = given(rng, 2 * k + 1)  # of 64 elements
        assert direct.solve(gripper, far_end=end).converged
    assert set(sought) == {64}
    assert len(sought) < 1.25 * COUNT  # what the way led to is near, mostly


def test_strains_go_to_the_coarse_mesh_and_back():
    mesh = DirectSimulator(Rod(1.0, 0.05, 0.02, 0.015), n_elements=64,
                           basis='local').mesh
    middles, wanted = (0.5 * (s[1:] + s[:-1]) for s in (mesh.s, mesh.coarser.s))
    linear = np.outer(middles, [1.0, -2.0, 0.5]) + 3.0
    coarse = np.outer(wanted, [1.0, -2.0, 0.5]) + 3.0
    np.testing.assert_allclose(mesh.restriction @ linear, coarse, atol=1e-14)
    np.testing.assert_allclose(mesh.prolongation @ coarse, linear, atol=1e-13)


def test_what_a_coarse_mesh_does_not_show_is_sought_on_the_mesh_itself(tried):
    rod = Rod(1.0, 0.05, 0.02, 0.015, radius=3e-3)
    level = Pose((0, 0, 0), (0, 0, 0, 1))
    fine, few = (DirectSimulator(rod, n_elements=count, basis='local') for count in (64, 24))

    def place(x, turn=(0, 0, 0, 1)):
        return Pose((x, 0.0, 0.05), turn)

    yielding = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, yield_stress=400e6)
    for direct, end, holds in (
            (few, place(0.6), ()),  # it has few elements anyway
            # nearly taut: it bends next to its clamps
            (fine, Pose.looking_along((0.97, 0, 0), (1, 1.5, 0)), ()),
            (fine, place(0.6), [Hold(place(0.3), s=0.45)]),
            (DirectSimulator(yielding, n_elements=64, basis='local'), place(0.6), ()),
            (DirectSimulator(rod, n_elements=64, basis='local', grip='pinned'), place(0.6), ())):
        tried.clear()
        assert direct.solve(level, far_end=end, holds=holds).converged
        assert not any(tried)
