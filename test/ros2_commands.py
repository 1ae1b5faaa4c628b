# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What commands of `ros2` do, as pages print them, to a node in this process."""

import importlib
import re

import yaml
from node_inside import state
from planner_process import PATIENCE, drain, until

from dlo_planner.ros.lifecycle import LATCHED

_COMMAND = re.compile(r'^    ros2 (topic pub --once|service call|param set|topic echo --once) '
                      r'(\S+) ?(\S*)(?: "?(.*?)"?)?$', re.M)


def commands_of(page):
    """Return (how, name, third, text) of each command of a page, in their order."""
    return _COMMAND.findall(page)


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
    """Return the number and the reason with which a call is refused, '' if it is not."""
    drain(client.statuses)
    answer, _ = client._call(kind, topic.removeprefix(f'{client.planner}/'), fill(
        kind.Request(), yaml.safe_load(text or '{}')))
    code, said, _ = client.status_of(topic.rsplit('/', 1)[1])
    while said != getattr(answer, 'message', said):  # what was executed before has its end there
        code, said, _ = client.status_of(topic.rsplit('/', 1)[1])
    done = answer.success if hasattr(answer, 'success') else bool(answer.plan.poses)
    assert done == (code == 0)  # the answer and ~/status agree
    return f'{code}: {said}' if code else ''


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


def run_inside(client, node, how, name, third, text):
    """Do what a command does; return what is said against it, '' if nothing is."""
    if how == 'param set':
        return set_to(client, third, text)
    if how == 'topic echo --once':
        return heard(client, name)
    if how == 'service call':
        return called(client, name, of_type(third), text)
    return published(client, node, name, of_type(third), text)
