# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's figures: each has its script, and what their page says of them holds."""

import ast
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('matplotlib')

from benchmarks import figures, reproduction, speculation  # noqa: E402
from benchmarks.cases import BAR, level, local, turned, wire  # noqa: E402
from benchmarks.figures import (  # noqa: E402
    fig01_stress_strain,
    fig03_adding,
    fig11_obstacle,
    fig13_threading,
)
from dlo_planner import DirectSimulator  # noqa: E402

pytestmark = pytest.mark.sweep  # the package has tests of its own


def off(shape, reference):
    """Return the largest distance of a node, m."""
    return np.linalg.norm(shape.positions - reference, axis=1).max()


def test_each_of_the_16_figures_has_a_script_that_says_what_it_shows():
    assert list(figures.scripts()) == [f'fig{k:02d}' for k in range(1, 17)]
    for name, module in figures.scripts().items():
        script = ast.parse((Path(figures.__file__).parent / f'{module}.py').read_text())
        assert ast.get_docstring(script).startswith(f'Fig. {int(name[3:])}: ')
        assert ast.unparse(script.body[-1]).endswith('run(main)')  # and can be run by itself


def test_a_figure_is_made_as_png_svg_and_table(tmp_path):
    figures.main(tmp_path, ['fig03'])
    assert {path.name for path in tmp_path.iterdir()} == {f'fig03.{kind}' for kind in (
        'png', 'svg', 'md', 'json')}
    first = (tmp_path / 'fig03.svg').read_bytes()
    figures.main(tmp_path, ['fig03'])
    assert (tmp_path / 'fig03.svg').read_bytes() == first


def test_a_cycle_of_bending_leaves_what_is_beyond_the_yield_curvature():
    there = fig01_stress_strain.moments(np.append(np.linspace(0.1, 2.5, 25), [2.0, 1.5]), 'ideal')
    np.testing.assert_allclose(there[[9, 14, 24, 25, 26]], [1, 1, 1, 0.5, 0], atol=1e-9)


def test_curvatures_add_as_eq_14b_says(rng):
    for _ in range(20):
        one, other = zip(rng.uniform(0.1, 2, 2), rng.uniform(-3, 3, 2), strict=True)
        found = fig03_adding.vector(fig03_adding.added(one, other))
        np.testing.assert_allclose(
            found, fig03_adding.vector(one) + fig03_adding.vector(other), atol=1e-12)


@pytest.mark.parametrize(('mass', 'terms', 'least', 'most'), [
    (0.0, 10, 1e-9, 2e-8), (1.0, 10, 5e-4, 2e-3), (1.0, 20, 1e-6, 1e-5)])
def test_about_ten_chebyshev_terms_are_enough_for_a_but_not_for_b(mass, terms, least, most):
    rod = wire(tip_mass=mass)
    true = local(rod=rod).solve(turned(0)).positions
    assert least < off(DirectSimulator(rod, n_elements=64, n_terms=terms).solve(turned(0)),
                       true) < most


def test_the_fourier_reference_of_the_paper_is_not_the_true_shape():
    true = local().solve(turned(0)).positions
    shapes = {n: DirectSimulator(wire(), basis='fourier', n_elements=64, n_terms=n).solve(turned(0))
              for n in (24, 32)}
    assert off(shapes[32], true) == pytest.approx(5.1e-3, rel=0.05)
    # seen from that reference it converges, as every series does to its own last member
    assert off(shapes[24], shapes[32].positions) < 0.4 * off(shapes[24], true)


def test_the_error_falls_with_the_square_of_the_elements_and_has_no_floor_at_15():
    true = local(960).solve(turned(0))
    found = {}
    for n in (15, 30, 60, 120):
        shape = DirectSimulator(wire(), n_elements=n, n_terms=min(16, n)).solve(turned(0))
        found[n] = off(shape, true.positions_at(shape.s))
    assert found[15] > 5e-4
    for n in (15, 30, 60):
        assert found[n] / found[2 * n] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize('terms', [2, 10])
def test_the_simplex_needs_more_than_dfp(terms):
    spent = {method: DirectSimulator(wire(), n_elements=32, n_terms=terms, method=method)
             .solve(turned(0)).evaluations for method in ('dfp', 'downhill_simplex')}
    # with each gradient from differences, as where nothing is known of it, DFP needs fewer still
    assert spent['downhill_simplex'] > (3 * terms + 1) * spent['dfp']


def test_benchmark_d_can_begin_with_any_right_shape_before():
    simulator = DirectSimulator(wire(), obstacles=[BAR])
    followed = simulator.track([level(z) for z in fig11_obstacle.HEIGHTS])
    alone = [simulator.solve(shape.gripper) for shape in followed]
    assert fig11_obstacle.wrong(alone, followed) == [7, 8, 9]
    for back in (1, 4, 8):
        assert not fig11_obstacle.wrong(fig11_obstacle.begun(simulator, followed, back), followed)


def test_only_an_insertion_follows_the_first_shape():
    inverse = fig13_threading.InverseSimulator(DirectSimulator(wire(1.6e-3)))
    goal = fig13_threading.hole(fig13_threading.GOAL)
    plans = {name: getattr(inverse, name)(goal, depths=fig13_threading.DEPTHS)
             for name in ('thread', 'insert')}
    curve = plans['thread'].shapes[0].positions_at(np.linspace(0, 1, 4001))
    gone = {name: max(np.linalg.norm(curve - gripper.position, axis=1).min()
                      for gripper in plan.grippers) for name, plan in plans.items()}
    assert gone['insert'] < 1e-4 and gone['thread'] > 0.1


@pytest.mark.parametrize(('case', 'least', 'most'), list(zip(
    speculation.CASES, (1.1, 0.9, 1.5), (1.5, 1.05, 2.5), strict=True)))
def test_what_newtons_method_gains_from_three_tasks(case, least, most):
    recorded = {tasks: speculation.CASES[case]('newton', tasks) for tasks in (1, 3)}
    assert len(recorded[1]) == len(recorded[3])
    (_, alone, _), (_, gain, _) = speculation.speedups(recorded, 'newton', ideal=True)
    assert alone == 1.0 and least < gain < most


def test_the_numbers_of_the_page_are_those_that_the_scripts_wrote():
    written = reproduction.PAGE.read_text()
    assert reproduction.updated(written) == written
    with pytest.raises(ValueError, match='simplex'):
        reproduction.updated(written.replace('the simplex is', 'it is'))
