# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Forces of contacts of a linear body: Coulomb's law, held against SciPy and closed forms."""

import numpy as np
import pytest
from scipy.optimize import nnls

from dlo_planner.minimize.contact_laws import (
    ContactLaws,
    contact_forces,
    force_after,
    yielding_forces,
)


def laws(compliance, gap, friction, force=None, stiffness=1e3, spring=0.0, free=0.0):
    """Return ContactLaws of contacts that rub, or do not (friction None), springs held to zero."""
    size, rubs = len(gap), friction is not None
    count = size // 3 if rubs else size
    first = np.arange(count + 1) * (3 if rubs else 1)
    springs = np.zeros((count, 3, 3))
    springs[:] = spring * np.eye(3)
    whole = np.zeros((size, size))
    for a in range(count):
        rows = slice(first[a], first[a + 1])
        whole[rows, rows] = springs[a][:first[1], :first[1]]
    held = np.linalg.inv(np.linalg.inv(compliance) + whole)  # with springs in the body
    return ContactLaws(first, np.asarray(gap, float),
                       np.zeros(size) if force is None else np.asarray(force, float), springs,
                       np.full(count, 0.0 if friction is None else float(friction)),
                       np.zeros(size) + free, held, stiffness, np.ones(count, dtype=np.bool_))


def solved(law, turns=8):
    """Return forces and gaps, or slips, after the change of the loads that is found."""
    known, change, _ = contact_forces(law, turns)
    assert known
    moved = law.free + law.compliance @ change
    forces = np.concatenate([force_after(law, a, change, moved)
                             for a in range(len(law.friction))])
    return forces, law.gap + moved


def wrong(forces, slips, friction):
    """Return the largest violation of the laws (natural map), as a part of the largest force."""
    worst = 0.0
    for (n, *across), (gap, *slip) in zip(forces.reshape(-1, 3), slips.reshape(-1, 3), strict=True):
        worst = max(worst, abs(min(n, gap)), -min(n, 0.0))
        trial = np.array(across) - np.array(slip)
        size, limit = np.linalg.norm(trial), friction * max(n, 0.0)
        law = trial if size <= limit else trial * limit / size
        worst = max(worst, np.abs(law - across).max())
    return worst / np.abs(forces).max()


def body(rng, size, rank=None):
    """Return a compliance (size, size), of which so many eigenvalues are not nearly zero."""
    turn = np.linalg.qr(rng.normal(size=(size, size)))[0]
    values = 10.0 ** rng.uniform(-1, 1, size)
    values[rank or size:] = 1e-9
    return turn @ np.diag(values) @ turn.T


@pytest.mark.parametrize('seed', range(10))
def test_without_friction_the_energy_is_least(seed):
    rng = np.random.default_rng(seed)
    compliance, gap = body(rng, 12), rng.normal(size=12)
    forces, _ = solved(laws(compliance, gap, None))
    root = np.linalg.cholesky(compliance)  # least F C F / 2 + gap F of all F >= 0
    least, _ = nnls(root.T, -np.linalg.solve(root, gap))
    np.testing.assert_allclose(forces, least, rtol=0, atol=1e-7 * np.abs(least).max())


@pytest.mark.parametrize(('across', 'slides'), [(0.2, False), (0.9, True)])
def test_one_contact_sticks_or_slides_along_its_way(across, slides):
    # pressed in by 1 m, drawn by `across` m: with unit compliances forces are the displacements
    forces, places = solved(laws(np.eye(3), [-1.0, 0.6 * across, 0.8 * across], 0.5))
    size = 0.5 if slides else across
    np.testing.assert_allclose(forces, [1.0, -0.6 * size, -0.8 * size], rtol=0, atol=1e-9)
    np.testing.assert_allclose(places, np.array([0.0, 0.6, 0.8]) * (across - size), rtol=0,
                               atol=1e-9)


@pytest.mark.parametrize('spring', [0.0, 50.0])
@pytest.mark.parametrize('seed', range(20))
def test_many_contacts_keep_coulombs_law(seed, spring):
    rng = np.random.default_rng(seed)
    law = laws(body(rng, 18), rng.normal(size=18) - np.tile([1.0, 0, 0], 6), 0.4, spring=spring)
    assert wrong(*solved(law), 0.4) < 1e-4


def test_contacts_that_move_by_themselves_keep_coulombs_law():
    rng = np.random.default_rng(0)
    for spring in (0.0, 50.0):
        law = laws(body(rng, 18), rng.normal(size=18), 0.4, spring=spring,
                   free=rng.normal(size=18) - np.tile([1.0, 0, 0], 6))
        assert wrong(*solved(law), 0.4) < 1e-4


@pytest.mark.parametrize('scale', [1e-6, 1e6])
def test_a_stiff_body_keeps_coulombs_law_as_a_soft_one(scale):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        compliance, gap = body(rng, 18), rng.normal(size=18) - np.tile([1.0, 0, 0], 6)
        forces, slips = solved(laws(scale * compliance, scale * gap, 0.4, stiffness=1e3 / scale))
        assert wrong(forces, slips / scale, 0.4) < 1e-4


@pytest.mark.parametrize('seed', range(20))
def test_contacts_of_a_body_with_few_ways_to_move_keep_coulombs_law(seed):
    # eight contacts, and a body that moves in seven ways: what each bears is not determined
    rng = np.random.default_rng(seed)
    compliance = body(rng, 24, 7)
    gap = compliance @ rng.normal(size=24)
    assert wrong(*solved(laws(compliance, gap, 0.3, stiffness=1e4)), 0.3) < 1e-4


def test_contacts_that_depend_on_each_other_share():
    # two contacts at one place: what each bears is not determined, their sum is
    forces, places = solved(laws(np.ones((2, 2)) + 1e-12 * np.eye(2), [-1.0, -1.0], None))
    assert forces[0] == pytest.approx(forces[1])
    assert forces.sum() == pytest.approx(1.0, rel=1e-6)
    assert np.abs(places).max() < 1e-6


def test_a_force_that_turns_over_is_found_from_its_opposite():
    # slid to one side, then pushed back: with a stiff spring the force would go to and fro
    law = laws(np.diag([1.0, 0.07, 0.07]), [-1.0, -0.01, 0.0], 0.5, force=[0.0, -0.5, 0.0])
    forces, places = solved(law)
    assert forces[1] == pytest.approx(0.01 / 0.07 - 0.5, rel=1e-6)
    assert abs(places[1]) < 1e-9


@pytest.mark.parametrize('seed', range(4))
def test_yielding_contacts_approach_the_laws(seed):
    rng = np.random.default_rng(seed)
    law = laws(body(rng, 12), rng.normal(size=12), 0.4, np.abs(rng.normal(size=12)) * 0.1,
               stiffness=0.3, spring=0.3)
    for _ in range(60):  # what they yield by is counted anew
        known, change, _ = yielding_forces(law, 0.05)
        assert known
        moved = law.free + law.compliance @ change
        forces = np.concatenate([force_after(law, a, change, moved) for a in range(4)])
        law = law._replace(force=forces, gap=law.gap + moved, free=0.0 * moved)
    assert wrong(forces, law.gap, 0.4) < 1e-4  # as exactly as a step asks for


@pytest.mark.parametrize('seed', range(4))
def test_contacts_yield_to_a_change_of_their_forces(seed):
    rng = np.random.default_rng(seed)
    law = laws(body(rng, 6), -np.abs(rng.normal(size=6)), None, np.abs(rng.normal(size=6)),
               stiffness=0.3, spring=0.3, free=0.1 * rng.normal(size=6))
    known, change, bears = yielding_forces(law, 0.5)
    moved = law.free + law.compliance @ change
    forces = np.concatenate([force_after(law, a, change, moved) for a in range(6)])
    assert known and bears.any()
    own = np.linalg.inv(np.linalg.inv(law.compliance) - 0.3 * np.eye(6)).diagonal()
    gap = law.gap + moved + (0.5 + 1e-5 * own) * (forces - law.force)
    np.testing.assert_allclose(gap[bears], 0.0, atol=1e-9)
    assert (forces[bears] > 0.0).all() and (gap[~bears] > 0.0).all()


@pytest.mark.parametrize('own', [-2.0, 2.0])
def test_what_would_fall_once_it_is_let_go_is_no_solution(own):
    # the spring of the second contact, which bears nothing, holds up what is not stable
    law = laws(np.diag([1.0, 1.0, 1.0, own, 1.0, 1.0]), [-1.0, 0.0, 0.0, 1.0, 0.0, 0.0], 0.4,
               stiffness=1.0, spring=1.0)
    law.bears[1] = False
    known, _, bears = yielding_forces(law, 1e-3)
    assert bears.tolist() == [True, False] and known == (own > 0.0)
