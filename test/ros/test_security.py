# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The SROS 2 policy allows what the node opens, and nothing else."""

from fnmatch import fnmatchcase
from xml.etree import ElementTree

import pytest
from planner_here import context_of_its_own, opened, planner_here
from planner_process import ROOT, until

POLICY = ROOT / 'config' / 'sros2_policy.xml'
# What is opened only with use_sim_time, or where tf2_ros is installed.
# /rosout: rcl opens it for the first node of a name in a process, and one may still be there
AT_TIMES = {'/clock', '/tf', '/tf_static', '/rosout'}
RULES = {'publisher': ('topics', 'publish'), 'subscriber': ('topics', 'subscribe'),
         'service': ('services', 'reply'), 'client': ('services', 'request')}


def allowed(group, verb):
    """Return the full names that the policy allows for a verb."""
    root = ElementTree.parse(POLICY).getroot()
    assert (root.tag, root.get('version')) == ('policy', '0.2.0')
    profile, = root.iter('profile')
    private = profile.get('ns').rstrip('/') + '/' + profile.get('node')
    found = [one.text for rules in profile.iter(group) if rules.get(verb) == 'ALLOW'
             for one in rules]
    names = {private + name[1:] if name.startswith('~') else name for name in found}
    assert len(names) == len(found), 'a name stands there twice'
    assert all(name.startswith('/') for name in names)
    return names


@pytest.fixture
def active(own_domain, monkeypatch):
    with context_of_its_own() as context, planner_here(monkeypatch, context) as node:
        yield node


@pytest.mark.parametrize('kind', RULES)
def test_the_policy_is_what_the_node_opens(active, kind):
    # the graph may be late to know what is opened; topics of arms are there from a plan on
    rules = {name for name in allowed(*RULES[kind]) if not name.endswith('/*')}
    until(lambda: rules - AT_TIMES <= opened(active, kind))
    assert rules - AT_TIMES - opened(active, kind) == set(), 'allowed, but never opened'
    assert opened(active, kind) - rules == set(), 'it is opened, but not allowed'


@pytest.mark.parametrize(('kind', 'name'), [('publisher', 'gripper_command'),
                                            ('subscriber', 'gripper_pose')])
def test_the_topics_of_arms_are_allowed(active, kind, name):
    active.planning_server._arms._open('second')
    there = f'/dlo_planner/{name}/second'
    assert until(lambda: there in opened(active, kind))
    assert any(fnmatchcase(there, rule) for rule in allowed(*RULES[kind]))


@pytest.mark.sweep
def test_simulated_time_is_allowed(own_domain, monkeypatch):
    with context_of_its_own() as context, \
            planner_here(monkeypatch, context, use_sim_time=True) as node:
        assert until(lambda: '/clock' in opened(node, 'subscriber'))
        assert opened(node, 'subscriber') - allowed('topics', 'subscribe') == set()
