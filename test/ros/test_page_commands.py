# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The commands of the pages of tasks and grips, in their order, as the launch starts the node."""

from time import monotonic, sleep

import pytest
import yaml
from launching import arguments_of, described
from node_inside import Alive
from planner_here import context_of_its_own, planner_here
from planner_process import ROOT, connected_client
from ros2_commands import commands_of, run_inside

from dlo_planner.settings.parameters import PARAMETERS

PAGES = [(ROOT / 'docs' / 'ros' / f'{name}.md').read_text() for name in ('tasks', 'grips')]
COMMANDS = commands_of('\n'.join(PAGES))
DLO = arguments_of(described(ROOT / 'launch' / 'planner.launch.py'))['rod']
FILE = ROOT / 'config' / f'{DLO}.yaml'
PATIENCE = 30.0  # s, for a proof that is still being made


@pytest.mark.parametrize('arguments', [['--params-file', str(FILE)], []], ids=['launch', 'alone'])
def test_the_commands_of_the_page_do_what_they_say(domain, monkeypatch, arguments):
    if not arguments:
        monkeypatch.setattr('planner_here.WIRE', ())
    assert len(COMMANDS) == 27
    refused = {}
    with context_of_its_own() as context, planner_here(
            monkeypatch, context, *arguments) as node, connected_client(Alive()) as client:
        for how, name, third, text in COMMANDS[:None if arguments else 3]:
            said = run_inside(client, node, how, name, third, text)
            end = monotonic() + PATIENCE
            while said and said.startswith('300: ') and monotonic() < end:  # 'ask again'
                sleep(0.2)
                said = run_inside(client, node, how, name, third, text)
            if said:
                refused[name, text[:60]] = said
    assert not refused


def test_a_node_without_a_file_has_the_dlo_of_the_launch():
    given = yaml.safe_load(FILE.read_text())['/**']['ros__parameters']['rod']
    defaults = {name: PARAMETERS[f'rod.{name}'].default for name in given}
    assert {name: type(defaults[name])(value) for name, value in given.items()} == defaults


def test_who_says_nothing_of_the_dlo_is_told_which_it_is(domain, monkeypatch, capfd):
    monkeypatch.setattr('planner_here.WIRE', ())
    with context_of_its_own() as context, planner_here(monkeypatch, context):
        pass
    assert 'the DLO is a copper wire, 1 m long and 1 mm thick' in capfd.readouterr().err
