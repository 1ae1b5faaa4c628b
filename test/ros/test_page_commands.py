# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The commands of docs/ros_interface.md, as printed and in their order, as the launch starts it."""

import importlib
import re

import pytest
import yaml
from node_inside import Alive, state
from planner_here import context_of_its_own, planner_here
from planner_process import PATIENCE, ROOT, connected_client, drain, until

from dlo_planner.ros.lifecycle import LATCHED
from dlo_planner.settings.parameters import PARAMETERS

PAGE = (ROOT / 'docs' / 'ros_interface.md').read_text()
COMMANDS = re.findall(r'^    ros2 (topic pub --once|service call|param set|topic echo --once) '
                      r'(\S+) ?(\S*)(?: "?(.*?)"?)?$', PAGE, re.M)
LAUNCH = (ROOT / 'launch' / 'planner.launch.py').read_text()
DLO = re.search(r"'rod', default_value='(\w+)'", LAUNCH)[1]
FILE = ROOT / 'config' / f'{DLO}.yaml'


def of_type(name):
    """Return the class of a type, 'package/msg/Name' or 'package/Name'."""
    package, *kind, name = name.split('/')
    return getattr(importlib.import_module('.'.join([package, *(kind or ['msg'])])), name)


def fill(message, values):
    """Fill a message as the command `ros2` does."""
    for name, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        elif isinstance(value, list):
            kind = of_type(message.get_fields_and_field_types()[name][len('sequence<'):-1])
            setattr(message, name, [fill(kind(), one) for one in value])
        else:
            setattr(message, name, type(getattr(message, name))(value))
    return message


def published(client, node, topic, kind, text):
    """Publish once; return what is said against it."""
    drain(client.statuses)
    out = client.node.create_publisher(kind, topic, 10)
    assert until(out.get_subscription_count)
    before = state(node)
    out.publish(fill(kind(), yaml.safe_load(text)))
    if topic.endswith('/task'):
        code, said, _ = client.status_of('task', PATIENCE)
        return said if code else ''
    taken = (lambda: state(node).scene.bodies) if topic.endswith('/obstacles') else (
        lambda: state(node).pose is not None and state(node).shape is not before.shape)
    return '' if until(taken) else 'nothing came of it'


def called(client, topic, kind, text):
    answer, _ = client._call(kind, topic.removeprefix(f'{client.planner}/'), fill(
        kind.Request(), yaml.safe_load(text)))
    if answer.plan.poses:
        return ''
    return client.status_of(topic.rsplit('/', 1)[1])[1]


def set_to(client, name, text):
    result, = client.set_parameters(**{name.replace('.', '__'): yaml.safe_load(text)})
    return result.reason


def heard(client, topic):
    """Return what is wrong with the first message of a topic that somebody begins to hear."""
    kinds = dict(client.node.get_topic_names_and_types())
    if topic not in kinds:
        return 'no such topic'
    came = []
    made = client.node.create_subscription(of_type(kinds[topic][0]), topic, came.append, LATCHED)
    known = until(lambda: came)
    client.node.destroy_subscription(made)
    return '' if known else 'nothing came'


@pytest.mark.parametrize('arguments', [['--params-file', str(FILE)], []], ids=['launch', 'alone'])
def test_the_commands_of_the_page_do_what_they_say(domain, monkeypatch, arguments):
    if not arguments:
        monkeypatch.setattr('planner_here.WIRE', ())
    assert len(COMMANDS) == 17
    refused = {}
    with context_of_its_own() as context, planner_here(
            monkeypatch, context, *arguments) as node, connected_client(Alive()) as client:
        for how, name, third, text in COMMANDS[:None if arguments else 3]:
            if how == 'param set':
                said = set_to(client, third, text)
            elif how == 'topic echo --once':
                said = heard(client, name)
            elif how == 'service call':
                said = called(client, name, of_type(third), text)
            else:
                said = published(client, node, name, of_type(third), text)
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
