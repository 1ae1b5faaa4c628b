# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML at the door: whatever a file holds, its content or a line that says what is wrong with it.

Content is judged by the tables of the YAML 1.2 specification (10.3, core schema).
"""

import math
import os
from pathlib import Path

import pytest
from properties import given, settings
from properties import strategies as st

from dlo_planner import InvalidTask
from dlo_planner.cli.io import read_poses
from dlo_planner.scene import Scene
from dlo_planner.settings.looks import read_observations
from dlo_planner.settings.tasks import read_task
from dlo_planner.settings.yaml_files import (
    config_file,
    load_yaml,
    read_values,
    read_yaml,
    yaml_of,
)

READERS = {'values': read_values, 'task': read_task, 'poses': read_poses,
           'obstacles': Scene.read, 'observations': lambda path: read_observations([path], [])}
BOMB = 'a0: &a0 [1, 1]\n' + ''.join(
    f'a{k}: &a{k} [{", ".join([f"*a{k - 1}"] * 10)}]\n' for k in range(1, 11))
WRONG = {  # what is written, and what is said of it
    'itself': (b'rod: &r {length: *r}', r'line 1: expected YAML, no \*r inside'),
    'deep': (b'[' * 2000 + b']' * 2000, 'line 1: expected YAML, at most 50 levels'),
    'deep keys': (b'{a: ' * 60 + b'1' + b'}' * 60, 'at most 50 levels'),
    'billions': (BOMB.encode(), 'line 7: expected YAML, at most 1000000 values'),
    'latin-1': ('a: 1\nrod.name: käbel'.encode('latin-1'), r'line 2: expected UTF-8.*0xe4'),
    'utf-16': ('a: 1'.encode('utf-16'), 'expected UTF-8, it is UTF-16'),
    'digits': (b'a: ' + b'1' * 5000, r'line 1.*digits'),
    'twice': (b'a: 1\nb: 2\na: 3', r"line 3: expected YAML, the key 'a' once"),
    'twice inside': (b'- {b: 1, "b": 2}', r"the key 'b' once"),
    'twice as a number': (b'{1: a, 0x1: b}', r'the key 1 once'),
    'a list as key': (b'[1, 2]: 3', 'a scalar as key'),
    'code': (b'!!python/object/apply:os.getcwd []', 'tag'), 'binary': (b'!!binary aGk=', 'tag'),
    'no float': (b'!!float x', "float, not 'x'"), 'list as map': (b'!!map [1]', 'mapping'),
    'two': (b'a: 1\n---\nb: 2', 'single document'), 'nul': (b'a: \0', 'character'),
    'large': (b'# ' + b'a' * 2**22, 'at most 4194304 bytes')}


@pytest.mark.parametrize('reader', READERS)
@pytest.mark.parametrize('name', WRONG)
def test_what_is_wrong_is_said_with_its_line_by_whatever_reads(tmp_path, name, reader):
    content, said = WRONG[name]
    path = tmp_path / 'odd.yaml'
    path.write_bytes(content)
    with pytest.raises(InvalidTask, match=f'odd.yaml.*{said}'):
        READERS[reader](path)


@pytest.mark.parametrize('reader', READERS)
def test_what_is_no_file_is_refused_without_waiting(tmp_path, reader):
    os.mkfifo(tmp_path / 'pipe.yaml')
    (tmp_path / 'folder.yaml').mkdir()
    for name, said in (('pipe', 'it is a pipe'), ('folder', 'it is a folder')):
        with pytest.raises(InvalidTask, match=f'{name}.yaml.*{said}'):
            READERS[reader](tmp_path / f'{name}.yaml')
    with pytest.raises(InvalidTask, match='it is a device'):
        READERS[reader](Path('/dev/zero'))


@pytest.mark.parametrize(('text', 'content'), [
    ('1:30', '1:30'), ('0o10', 8), ('0x1F', 31), ('0', 0), ('01.5', 1.5), ('+5', 5), ('-0', 0),
    ('1_000', '1_000'), ('0b11', '0b11'), ('yes', 'yes'), ('off', 'off'), ('y', 'y'),
    ('true', True), ('FALSE', False), ('tRue', 'tRue'), ('~', None), ('', None), ('Null', None),
    ('8e3', 8e3), ('1.', 1.0), ('.5', 0.5), ('-.5E+2', -50.0), ('1e', '1e'), ('.inf', math.inf),
    ('-.INF', -math.inf), ('2026-01-01', '2026-01-01'), ('=', '='), ('<<', '<<'), ('"1"', '1'),
    ('!!str 1', '1'), ('!!float 1', 1.0), ('!!int "1"', 1)])
def test_scalars_are_those_of_the_core_schema(text, content):
    found = load_yaml(f'- {text}', 'text')[0]
    assert found == content and type(found) is type(content)


@pytest.mark.parametrize('text', ['010', '-010', '09', '00', '!!int 010', '0' + '1' * 500])
def test_a_whole_number_that_begins_with_0_is_refused_it_is_of_base_8_elsewhere(text):
    for one in (f'- {text}', f'{{{text}: 1}}', f'a: [{text}]'):
        with pytest.raises(InvalidTask, match='line 1: expected YAML, a number without a lead'):
            load_yaml(one, 'task')
    assert load_yaml(yaml_of(['010']), 'text') == ['010']  # a string is quoted


def test_nan_aliases_and_a_byte_order_mark_are_read(tmp_path):
    path = tmp_path / 'some.yaml'
    path.write_bytes(b'\xef\xbb\xbfa: &a [1, .nan]\nb: *a\n"<<": *a\n')
    found = read_yaml(path)
    assert found['b'] == found['<<'] == found['a'] and math.isnan(found['a'][1])


@pytest.mark.parametrize('text', [
    'rod: {length: 1.0}\n    rod.length: 2.0', 'rod.length: 1.0\n    rod: {length: 2.0}'])
def test_a_parameter_twice_in_two_ways_is_refused(tmp_path, text):
    path = tmp_path / 'dlo.yaml'
    path.write_text(f'/**:\n  ros__parameters:\n    {text}\n')
    with pytest.raises(InvalidTask, match=r'dlo\.yaml: parameter rod\.length: expected once'):
        read_values(path)


@pytest.mark.parametrize('text', ['1:30', '{}', '"1"', 'yes'])
def test_no_number_is_none_as_a_length(tmp_path, text):
    path = tmp_path / 'dlo.yaml'
    path.write_text(f'/**:\n  ros__parameters:\n    rod: {{length: {text}}}\n')
    with pytest.raises(InvalidTask, match=r'parameter rod\.length = .*: expected a float'):
        read_values(path)


def test_many_unknown_names_take_no_longer_than_some(tmp_path):
    path = tmp_path / 'dlo.yaml'
    path.write_text(config_file('copper_wire').read_text() + ''.join(
        f'    lenght{k}: 1\n' for k in range(3000)))
    warnings = read_values(path)[1]
    assert len(warnings) == 21 and warnings[-1].startswith('2980 more')


ODD_STRINGS = ('1e3', '0o17', '08', '1:30', '.5', 'yes', '~', '0x1', '2026-01-01', '-.inf', '')
STRINGS = st.sampled_from(ODD_STRINGS) | st.text(
    st.characters(codec='utf-8', exclude_categories=['Cc', 'Cs']))


@settings(max_examples=60)
@given(st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | STRINGS,
    lambda inner: st.lists(inner) | st.dictionaries(st.text('abc1.e'), inner), max_leaves=8))
def test_what_is_written_is_read_again_as_it_was(content):
    again = load_yaml(yaml_of(content), 'text')
    assert again == content and repr(again) == repr(content)
