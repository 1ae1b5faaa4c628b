# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters from YAML: the node's table, its types and limits, names that mean nothing."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from dlo_planner import DirectSimulator, InvalidTask, Rod
from dlo_planner.identify import Fit
from dlo_planner.model.rod import doubts
from dlo_planner.plan.requirements import Limits
from dlo_planner.settings.build import (
    direct_of,
    inverse_of,
    limits_of,
    parameters_of_fit,
    rod_of,
    spread_of,
    tolerance_of,
)
from dlo_planner.settings.parameters import PARAMETERS, within_limits
from dlo_planner.settings.yaml_files import config_files, read_values, write_values

HEAD = '/**:\n  ros__parameters:\n'
WIRE = ('    rod:\n      diameter: 0.001\n      density: 8960.0\n      youngs_modulus: 110.0e9\n'
        '      poisson_ratio: 0.34\n      length: 1.0\n')


def written(folder, text, head=HEAD):
    path = folder / 'dlo.yaml'
    path.write_text(head + text)
    return path


def test_a_file_of_config_describes_its_rod():
    values, warnings = read_values('copper_wire')
    assert warnings == []
    assert values['rod.youngs_modulus'] == 110e9  # YAML 1.1 takes 110.0e9 for a word
    assert rod_of(values) == Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34,
                                          natural_curvature=(0.0, 0.0), damping=(0.0, 0.0))


@pytest.mark.parametrize('name', ['copper_wire', 'rubber_hose', 'steel_leaf_spring'])
def test_every_file_of_config_is_read_by_name_and_by_path(name):
    by_name, _ = read_values(name)
    assert by_name == read_values(config_files()[name])[0]
    assert by_name.keys() == PARAMETERS.keys()
    for key, entry in PARAMETERS.items():
        assert type(by_name[key]) is type(entry.default), key
    simulator = direct_of(by_name)
    assert inverse_of(by_name, simulator).simulator.rod == simulator.rod


def test_changes_count_more_than_the_file():
    values, _ = read_values('copper_wire', ['rod.diameter=0.0015', 'rod.length:=2',
                                            'workspace.lower=[-1, -1, 0]',
                                            'threading.may_yield=false'])
    assert values['rod.diameter'] == 0.0015
    assert values['rod.length'] == 2.0 and isinstance(values['rod.length'], float)
    assert values['workspace.lower'] == [-1.0, -1.0, 0.0]
    assert values['threading.may_yield'] is False


def test_a_dlo_that_is_described_in_part_is_refused_by_name(tmp_path):
    given = {'round': 'length diameter density youngs_modulus poisson_ratio',
             'tube': 'length diameter inner_diameter density youngs_modulus poisson_ratio',
             'rectangular': 'length width thickness density youngs_modulus poisson_ratio',
             'stiffness': 'length diameter mass_per_length torsional_stiffness bending_stiffness'}
    sizes = {'poisson_ratio': 0.3, 'inner_diameter': 5e-3, 'bending_stiffness': [0.1, 0.2],
             'length': 1.0, 'density': 1e3, 'youngs_modulus': 1e9}
    for section, text in given.items():
        names = text.split()
        for absent in [None, *names]:
            lines = ''.join(f'      {name}: {sizes.get(name, 0.01)}\n'
                            for name in names if name != absent)
            path = written(tmp_path, f'    rod:\n      section: {section}\n{lines}')
            if absent is None:
                assert read_values(path)[1] == []
            else:
                with pytest.raises(InvalidTask, match=rf'rod\.{absent}: expected'):
                    read_values(path)
    with pytest.raises(InvalidTask, match=r'dlo\.yaml.*did you mean rod\.length\?'):
        read_values(written(tmp_path, '    rod: {lenght: 2.0}\n'))
    with pytest.raises(InvalidTask, match=r'did you mean rod\.length'):
        read_values('copper_wire', ['rod.lenght=2'])


def test_what_has_no_effect_is_said(tmp_path):
    path = written(tmp_path, f'{WIRE}      width: 0.02\n    nonsense: 1\n')
    first, second = read_values(path)[1]
    assert 'nonsense does not exist' in first
    assert second == 'parameter rod.width has no effect where rod.section is round'


@pytest.mark.parametrize(('changes', 'said'), [
    ([], None), (['rod.length=0.0098'], '0.001 m thick, 0.0098 m long'),
    (['rod.youngs_modulus=1e6'], 'w L^3 / EI = 1.4'), (['rod.density=8.96'], 'is it in kg/m^3')])
def test_what_is_hardly_meant_is_doubted(changes, said):
    found = doubts(rod_of(read_values('copper_wire', changes)[0]))
    assert len(found) == (said is not None)
    assert said is None or said in found[0]


@pytest.mark.parametrize(('text', 'head', 'named'), [
    ('    rod: {length: 1000}\n', HEAD, r'rod\.length = 1000\.0: expected 0\.001 to 100'),
    ('    rod: {length: long}\n', HEAD, r'rod\.length'),
    ('    simulator: {n_elements: 1}\n', HEAD, r'simulator\.n_elements = 1: expected 2 to 2000'),
    ('    gravity: 9.81\n', HEAD, 'gravity'), ('    rod: [\n', HEAD, 'expected YAML'),
    ('    arm: {joints: 5}\n', HEAD, r'arm\.joints = 5: expected a list of strings'),
    ('    rod: {length: 1' + 400 * '0' + '}\n', HEAD, r'rod\.length'),
    ('    rod: {length: }\n', HEAD, r'rod\.length = None'),
    ('    rod: {length: .nan}\n', HEAD, r'rod\.length = nan'),
    ('', '/**:\n', 'ros__parameters'), ('rod: {length: 1.0}\n', '', r'under /\*\*'),
    ('', 'other_node:\n  ros__parameters: {a: 1}\n', r'under /\*\*')])
def test_what_makes_no_sense_is_named(tmp_path, text, head, named):
    with pytest.raises(InvalidTask, match=named):
        read_values(written(tmp_path, text, head))


@pytest.mark.parametrize(('name', 'unit'), [
    ('rod.length', ' m'), ('rod.density', ' kg/m^3'), ('rod.mass_per_length', ' kg/m'),
    ('rod.torsional_stiffness', ' N m^2'), ('rod.yield_torsion', ' 1/m'), ('rod.tip_mass', ' kg'),
    ('threading.linear_speed', ' m/s'), ('threading.linear_acceleration', ' m/s^2'),
    ('threading.angular_jerk', ' rad/s^3'), ('execute.longest_pause', ' s'),
    ('observe.kink', ' rad'), ('rod.poisson_ratio', ''), ('simulator.n_elements', '')])
def test_a_range_is_said_with_the_unit_of_its_parameter(name, unit):
    entry = PARAMETERS[name]
    with pytest.raises(InvalidTask) as refused:
        within_limits(name, -1e9, entry)
    assert str(refused.value).endswith(f': expected {entry.lowest:g} to {entry.highest:g}{unit}')


def test_a_file_that_is_not_there():
    with pytest.raises(InvalidTask, match='copper_wire, rubber_hose, steel_leaf_spring'):
        read_values('bamboo')
    with pytest.raises(InvalidTask, match='name=value'):
        read_values('copper_wire', ['rod.length'])


def test_values_of_other_nodes_do_not_count(tmp_path):
    path = written(tmp_path, f'{WIRE}camera:\n  ros__parameters:\n'
                   '    rod: {length: 3.0}\n')
    assert read_values(path)[0]['rod.length'] == 1.0


def test_what_is_written_is_read_again(tmp_path):
    values, _ = read_values('rubber_hose', ['threading.tolerance=1e-5', 'rod.name="a: b"'])
    path = tmp_path / 'again.yaml'
    write_values(path, values)
    assert read_values(path) == (values, [])


def test_limits_and_tolerance():
    values, _ = read_values('copper_wire', ['threading.linear_jerk=7', 'threading.tolerance=0'])
    assert limits_of(values).linear_jerk == 7.0
    assert tolerance_of(values) is None
    assert tolerance_of(values | {'threading.tolerance': float('nan')}) is None
    assert tolerance_of(values | {'threading.tolerance': 0.01}) == 0.01
    with pytest.raises(InvalidTask, match='tolerance'):
        tolerance_of(values | {'threading.tolerance': 2.0})


def test_the_files_are_those_of_the_sources():
    sources = (Path(__file__).parents[2] / 'config').glob('*.yaml')
    assert {name: path.read_text() for name, path in config_files().items()} == {
        path.stem: path.read_text() for path in sources}


MORE = {'natural_twist': 0.3, 'tip_mass': 0.01, 'damping': [0.1, 0.002], 'hardening': 0.2,
        'section_model': 'ideal', 'max_bend_curvature': 7.0, 'natural_curvature': [0.4, 0.5]}
SOLID = {'density': 7800.0, 'youngs_modulus': 2e11, 'poisson_ratio': 0.3, 'yield_stress': 3e8}
OF_SECTIONS = {
    'round': ({'length': 1.2, 'diameter': 2e-3, **SOLID}, Rod.circular),
    'tube': ({'length': 1.2, 'diameter': 2e-3, 'inner_diameter': 1.2e-3, **SOLID},
             lambda diameter, **more: Rod.tube(outer_diameter=diameter, **more)),
    'rectangular': ({'length': 1.2, 'width': 8e-3, 'thickness': 1e-3, **SOLID}, Rod.rectangular)}


def described(section, parameters):
    return rod_of(read_values('copper_wire', [f'rod.section={section}', *(
        f'rod.{name}={value}' for name, value in parameters.items())])[0])


@pytest.mark.parametrize('section', OF_SECTIONS)
def test_each_parameter_of_a_section_is_that_of_its_rod(section):
    sizes, make = OF_SECTIONS[section]
    assert described(section, sizes | MORE) == make(**sizes, **MORE)


def test_each_parameter_of_a_stiffness_is_that_of_its_rod():
    stated = {'length': 1.2, 'mass_per_length': 0.03, 'bending_stiffness': [0.02, 0.03],
              'torsional_stiffness': 0.015, 'yield_torsion': 4.0}
    assert described('stiffness', {**stated, 'diameter': 6e-3, 'yield_curvature': [2.0, 3.0],
                                   **MORE}) == Rod(**stated, radius=3e-3,
                                                   yield_curvature=(2.0, 3.0), **MORE)
    one = described('stiffness', {**stated, 'yield_curvature': [2.0, 0.0]})
    assert one.yield_curvature == (2.0, 1e12)  # 0: never about that axis


def test_gravity_and_the_mesh_are_those_of_the_simulator():
    values, _ = read_values('copper_wire', ['gravity=[0, 1, -3]', 'simulator.n_elements=24',
                                            'simulator.n_terms=7'])
    rod = rod_of(values)
    assert direct_of(values) == DirectSimulator(rod, gravity=(0, 1, -3), n_elements=24, n_terms=7,
                                                basis='chebyshev')
    values |= {'simulator.basis': 'local'}
    assert direct_of(values) == DirectSimulator(rod, gravity=(0, 1, -3), n_elements=24,
                                                basis='local')
    values |= {'simulator.accuracy': 1e-3}
    assert direct_of(values) == DirectSimulator(rod, gravity=(0, 1, -3), accuracy=1e-3,
                                                basis='local')
    values |= {'simulator.self_contact': True, 'simulator.self_friction': 0.3}
    touching = direct_of(values)
    assert touching == DirectSimulator(rod, gravity=(0, 1, -3), accuracy=1e-3, basis='local',
                                       self_contact=True, self_friction=0.3)
    with pytest.raises(InvalidTask, match=r'simulator\.self_contact = True: expected False: plans'):
        inverse_of(values, touching)


@pytest.mark.parametrize(('change', 'named'), [
    ('simulator.accuracy=1e-7', 'parameter simulator.accuracy = 1e-07: expected at least 1e-06 m'),
    ('gravity=[0, 8e3, -8e3]', 'parameter gravity = .*: expected a length of at most 10000 m/s')])
def test_sizes_that_would_take_for_ever_are_refused_by_name(change, named):
    with pytest.raises(InvalidTask, match=named):
        direct_of(read_values('copper_wire', [change])[0])


@pytest.mark.parametrize('length', [0.3, 1.0, 12.0])
def test_how_straight_a_dlo_is_does_not_depend_on_its_size(length):
    values, _ = read_values('copper_wire', [f'rod.length={length}'])
    spread = spread_of(values)
    assert spread.natural_curvature * length == pytest.approx(0.05)
    assert spread.curvature_variation * length == pytest.approx(0.03)
    coiled = spread_of(values | {'rod.natural_curvature': [0.0, 30.0]})
    assert coiled.natural_curvature == pytest.approx(6.0, rel=1e-3)
    stated = spread_of(values | {'spread.natural_curvature': 0.0})
    assert (stated.natural_curvature, stated.curvature_variation) == (
        0.0, spread.curvature_variation)


def test_each_spread_and_limit_is_that_of_its_name():
    values, _ = read_values('copper_wire')
    given = {name: 1e-3 * k for k, name in enumerate(
        (one for one in values if one.startswith('spread.')), start=1)}
    spread = spread_of(values | given)
    assert {f'spread.{item.name}': getattr(spread, item.name) for item in fields(spread)} == given
    given = {f'threading.{item.name}': 0.1 * k for k, item in enumerate(fields(Limits), start=1)}
    limits = limits_of(values | given)
    assert {f'threading.{one.name}': getattr(limits, one.name) for one in fields(limits)} == given


PLACES = [0.1, 0.4]


def found(values, **changed):
    """Return a Fit that found these values."""
    rod = rod_of(values)
    if 'bending_stiffness' in changed:
        rod = replace(rod, section=None, section_model=None)
    return Fit(replace(rod, **changed), changed, dict.fromkeys(changed, 0.1), 0.0, True)


@pytest.mark.parametrize('name', ['copper_wire', 'rubber_hose', 'steel_leaf_spring'])
@pytest.mark.parametrize('factors', [(1.1, 1.1, 1.0), (1.1, 1.15, 0.9), (1.5, 0.7, 1.2)])
def test_stiffness_torsion_and_mass_are_as_found(name, factors):
    values, _ = read_values(name)
    rod = rod_of(values)
    (torsion, *bending), = rod.stiffnesses([0.1])
    mass, = rod.masses_per_length([0.1])
    bend, twist, heavy = factors
    fit = found(values, bending_stiffness=tuple(bend * one for one in bending),
                torsional_stiffness=twist * torsion, mass_per_length=heavy * mass)
    again = rod_of(values | parameters_of_fit(fit, values))
    np.testing.assert_allclose(again.stiffnesses(PLACES), fit.rod.stiffnesses(PLACES), rtol=1e-9)
    np.testing.assert_allclose(again.masses_per_length(PLACES), heavy * mass, rtol=1e-9)
    poisson = (1 + values['rod.poisson_ratio']) * bend / twist - 1
    assert (again.section is None) == (poisson > 0.5)  # no section has that torsion


def test_what_a_parameter_says_itself_is_taken_as_it_is():
    values, _ = read_values('copper_wire')
    fit = found(values, natural_curvature=(0.1, -0.2), natural_twist=0.3, tip_mass=0.01)
    assert parameters_of_fit(fit, values) == {'rod.natural_curvature': [0.1, -0.2],
                                       'rod.natural_twist': 0.3, 'rod.tip_mass': 0.01}


def test_a_rod_given_by_stiffness_stays_one():
    values, _ = read_values('copper_wire', [
        'rod.section=stiffness', 'rod.mass_per_length=0.007', 'rod.torsional_stiffness=0.004',
        'rod.bending_stiffness=[0.005, 0.005]'])
    fit = found(values, bending_stiffness=(0.01, 0.02))
    assert parameters_of_fit(fit, values) == {'rod.bending_stiffness': [0.01, 0.02]}


def test_what_no_parameter_says_is_refused():
    values, _ = read_values('copper_wire')
    fit = found(values, tip_mass=0.01)
    with pytest.raises(InvalidTask, match='bending_stiffness_n'):
        parameters_of_fit(replace(fit, values={'bending_stiffness_n': 1.0}), values)
    with pytest.raises(InvalidTask, match='natural_curvature'):
        parameters_of_fit(replace(fit, values={'natural_curvature': [[0, 1], [1, 0]]}), values)
