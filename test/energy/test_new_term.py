# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A new term of the potential takes one file and a few lines of `energy/terms.py`; a load a class.

A copy of the package gets the magnet of `magnet.py` by LINES alone, as CONTRIBUTING.md says. There
its derivatives are compared with differences and its effect with closed forms; as plain Python.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
HOME = 'dlo_planner.energy'
LENGTH, BENDING, SIZE = 0.8, 0.7, 0.2

# Of files in the package: a line that is there, and what is written behind it.
LOAD = [('AnyLoad: TypeAlias = PointLoad', ' | Pole'),
        ("put(self, s=number('PointLoad.s', self.s, minimum=0))\n        super().__post_init__()\n",
         """

@dataclass(frozen=True, eq=False, repr=False)
class Pole(Value):
    \"\"\"A pole that attracts a place of the DLO, s (m) or the tip: its own place (3,), m,
    the weight, J m, and its size, m.\"\"\"

    place: Floats
    weight: float
    size: float = 0.0
    s: float | None = None

    def __post_init__(self) -> None:
        put(self, place=vector('Pole.place', self.place, 3),
            weight=number('Pole.weight', self.weight), size=number('Pole.size', self.size))
        super().__post_init__()
""")]
LINES = [
    (f'from {HOME}.loads import potential as load_potential\n',
     f'from {HOME} import magnet\n'
     f'from {HOME}.magnet import add_forces as magnet_forces\n'
     f'from {HOME}.magnet import potential as magnet_potential\n'),
    ('    elastic: Elastic\n', '    magnet: Any  # Magnet or None\n'),
    ("TERMS = {'elastic': elastic,", " 'magnet': magnet,"),
    ('    energy, size = elastic_forces(effects.elastic, system, state)\n',
     '    more, terms = magnet_forces(effects.magnet, system, state)\n'
     '    energy, size = energy + more, size + terms\n'),
    ('    energy = load_potential(effects.load, system, positions)\n',
     '    energy += magnet_potential(effects.magnet, system, positions)\n'),
]

SCRIPT = f'''
import json
import numpy as np
from dlo_planner import (CutOut, DirectSimulator, InvalidTask, InverseSimulator, PointLoad, Pose,
                         Rod)
from dlo_planner.direct.discretization import Discretization
from dlo_planner.model.supports import Pole, Surroundings
from dlo_planner.energy.magnet import Magnet
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import new_configuration
from dlo_planner.energy.terms import potential
from MINIMIZER
from references.blocks import dense
from LINEAR

def attracted(pole, weight, size=0.0, n=16, origin=(0.0, 0.0, 0.0)):
    """Return the Problem of a level DLO without weight whose tip a pole attracts."""
    around = Surroundings(Rod({LENGTH}, 0.0, {BENDING}, 0.4), np.zeros(3))
    mesh = Discretization(around, np.linspace(0, {LENGTH}, n + 1), 'local', 0)
    weights = np.zeros(n + 1)
    weights[-1] = weight
    system = mesh.system(np.eye(3), np.array(origin))
    return system._replace(magnet=Magnet(np.array(pole, dtype=float), size, weights))

def fallen(system):
    found = newton(system, np.zeros_like(new_configuration(system).q), 1e-10, 100, True)
    return [found.residual, found.stability, found.kicks, found.state.positions[-1].tolist(),
            found.state.base_force.tolist()]

def at(system, q):
    state = new_configuration(system)
    state.q[:] = q
    return evaluate(system, state)[0], state

user = DirectSimulator(Rod({LENGTH}, 0.01, {BENDING}, 0.4), gravity=(0, 0, 0), basis='local',
                       n_elements=16, point_loads=[Pole(({LENGTH}, 0.0, 100.0), 1.0)])
shape = user.solve(Pose.identity())
moved = user.solve(Pose((0, 0, 0.1), (0, 0, 0, 1)), shape)
told = {{'refused': []}}
pole = Pole((0.1, 0.0, 0.3), 1.0, s=0.333)
for basis in ('local', 'chebyshev'):
    nodes = DirectSimulator(user.rod, basis=basis, n_elements=10, point_loads=[pole]).mesh.s
    assert np.abs(nodes - 0.333).min() < 1e-12, nodes
around = Surroundings(user.rod, np.zeros(3), point_loads=[PointLoad(s=0.1), pole])
told['parts'] = [[(type(one).__name__, one.s) for one in around.part(at, direction).point_loads]
                 for at, direction in ((0.2, 1), (0.2, -1), (0.5, -1))]
told['shorter'] = around.load_places
for length in (0.34, 0.33):
    around = around.of_rod(Rod(length, 0.01, {BENDING}, 0.4))
    told['shorter'] += around.load_places
try:
    Surroundings(Rod(0.3, 0.01, {BENDING}, 0.4), np.zeros(3), point_loads=[pole])
except InvalidTask as error:
    told['beyond'] = str(error)
for place in (lambda: shape.moved((0, 0, 0.1)),
              lambda: InverseSimulator(user).thread(CutOut(Pose.identity()), depths=[0, 0.1])):
    try:
        place()
    except InvalidTask as error:
        told['refused'].append(str(error))
told |= {{'user': [shape.converged, shape.positions[-1].tolist(), moved.converged,
                 len(shape.modes(2))], 'far': fallen(attracted(({LENGTH}, 0.0, 100.0), 1.0))}}
critical = 3 * {BENDING} / {LENGTH}**3 * {SIZE}**3
told['hill'] = [fallen(attracted(({LENGTH}, 0.0, 0.0), -(1 + 0.1 * sign) * critical, {SIZE}))
                for sign in (-1, 1)]

rng = np.random.default_rng(3)
origin = np.array([0.3, -0.2, 0.1])
system = attracted((0.5, 0.4, 0.6), 2.0, 0.1, 6, origin)
q = rng.normal(size=new_configuration(system).q.shape)
energy, state = at(system, q)
told['tip'] = (origin + state.positions[-1]).tolist()
told['pull'] = state.pull[-1].tolist()
told['energy'] = [energy - 0.5 * np.sum(q**2),
                  potential(system.effects, system, state.positions + origin)]
hessian = new_hessian(system)
assemble(system, state, hessian)
matrix = dense(system, hessian).reshape(*q.shape, *q.shape)
told['slopes'], told['columns'] = [], []
for index in np.ndindex(q.shape):
    unit = np.zeros_like(q)
    unit[index] = 1.0
    column = matrix[(..., *index)]
    (up, high), (down, low) = at(system, q + 1e-6 * unit), at(system, q - 1e-6 * unit)
    told['slopes'].append([state.gradient[index], (up - down) / 2e-6])
    told['columns'].append([column.tolist(), ((high.gradient - low.gradient) / 2e-6).tolist()])
print(json.dumps(told))
'''.replace('MINIMIZER', 'dlo_planner.minimize.newton import newton').replace(
    'LINEAR', 'dlo_planner.minimize.hessian import assemble, new_hessian')


@pytest.fixture(scope='module')
def told(tmp_path_factory):
    copy = tmp_path_factory.mktemp('package')
    shutil.copytree(ROOT / 'dlo_planner', copy / 'dlo_planner',
                    ignore=shutil.ignore_patterns('compiled', '__pycache__'))
    folder = copy / 'dlo_planner' / 'energy'
    shutil.copy(Path(__file__).with_name('magnet.py'), folder)
    for path, lines in ((folder / 'terms.py', LINES),
                        (copy / 'dlo_planner' / 'model' / 'supports.py', LOAD)):
        text = path.read_text(encoding='utf-8')
        for there, more in lines:
            assert text.count(there) == 1, there
            text = text.replace(there, there + more)
        path.write_text(text, encoding='utf-8')
    done = subprocess.run([sys.executable, '-c', SCRIPT], cwd=copy, text=True, capture_output=True,
                          check=False, env={**os.environ, 'NUMBA_DISABLE_JIT': '1',
                               'PYTHONPATH': str(Path(__file__).parents[1])})
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_far_away_it_bends_as_a_small_force_at_the_tip_does(told):
    residual, _, _, tip, base_force = told['far']
    force = 1.0 / 100.0**2
    assert residual < 1e-10
    assert tip[2] == pytest.approx(force * LENGTH**3 / (3 * BENDING), rel=2e-3)
    assert base_force[2] == pytest.approx(-force, rel=1e-4)


def test_users_give_it_as_a_load(told):
    solved, tip, moved, modes = told['user']
    assert solved and moved and modes == 2
    np.testing.assert_allclose(tip, told['far'][3], atol=1e-9)


def test_a_load_with_a_place_has_a_node_there_and_stays_at_it(told):
    # (that there is a node is asserted where the script runs)
    after, before, all_before = told['parts']
    assert after == [['Pole', pytest.approx(0.133)]] and before == [['PointLoad', 0.1]]
    assert all_before == [['PointLoad', 0.4], ['Pole', pytest.approx(0.167)]]
    assert told['shorter'] == [0.1, 0.333, 0.1, 0.333, 0.1, 0.33]  # the end takes it along
    assert told['beyond'].startswith('Pole.s = 0.333: expected a place on the DLO')


def test_a_shape_in_it_is_not_carried_to_another_place(told):
    assert len(told['refused']) == 2  # by itself, and to where a cut-out is
    assert all('point_loads: expected PointLoads alone' in one for one in told['refused'])


def test_beside_the_tip_it_falls_where_the_field_is_stiffer_than_the_bending(told):
    # a bar 3 EI / L^3 stiff at its tip, with a repelling pole on top of it: the tip is on a hill of
    # curvature w / a^3, and leaves it once that is more than the bar's stiffness
    for falls, (residual, stability, kicks, tip, _) in enumerate(told['hill']):
        assert residual < 1e-10 and stability > -1e-7  # all sides are alike
        assert (np.linalg.norm(np.subtract(tip, (LENGTH, 0, 0))) > 0.01) == bool(falls)
        assert (kicks > 0) == bool(falls)


def test_its_potential_and_force_are_those_of_the_place_in_the_world(told):
    arm = np.subtract(told['tip'], (0.5, 0.4, 0.6))
    away = np.sqrt(np.sum(arm**2) + 0.1**2)
    np.testing.assert_allclose(told['pull'], 2.0 * arm / away**3, rtol=1e-12)
    np.testing.assert_allclose(told['energy'], -2.0 / away, rtol=1e-12)


def test_its_derivatives_are_those_of_differences(told):
    for slope, wanted in told['slopes']:
        assert slope == pytest.approx(wanted, abs=1e-8)
    for column, wanted in told['columns']:
        np.testing.assert_allclose(column, wanted, atol=1e-8)
