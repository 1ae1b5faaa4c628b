# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What reaches the scene: only what has changed."""

import numpy as np
import pytest

from dlo_planner import Pose
from dlo_planner.view.primitives import KINDS, Primitive
from dlo_planner.view.viser import Canvas


class Handle:
    """Notes what is set."""

    def __init__(self, scene, name):
        self.__dict__.update(scene=scene, name=name, changed=[])

    def __setattr__(self, name, value):
        self.changed.append(name)

    def remove(self):
        del self.scene.handles[self.name]


class Scene:
    """Notes what is added, as viser's scene takes it."""

    def __init__(self):
        self.handles, self.added = {}, []

    def __getattr__(self, method):
        def add(name, *_, **__):
            self.added.append((method, name))
            self.handles[name] = Handle(self, name)
            return self.handles[name]

        return add


@pytest.fixture
def scene():
    return Scene()


def tube(height, number=3):
    points = np.column_stack([np.arange(number), np.zeros(number), np.full(number, height)])
    return Primitive('dlo', 0, 'line', (1, 0, 0), points=points, colors=np.full((number, 3), 0.5),
                size=(0.01, 0, 0))


def box(x=0.0):
    return Primitive('obstacle', 0, 'box', (1, 0, 0), size=(1, 1, 1),
                pose=Pose((x, 0, 0), (0, 0, 0, 1)))


def test_what_stays_the_same_is_not_drawn_again(scene):
    canvas = Canvas(scene)
    for _ in range(3):
        canvas.show([tube(1.0), box()])
    assert len(scene.added) == 2
    canvas.show([tube(1.0), box(1.0)])
    assert [name for _, name in scene.added[2:]] == ['/obstacle/0']


def test_a_tube_moves_in_place_and_is_made_anew_with_other_points(scene):
    canvas = Canvas(scene)
    canvas.show([tube(1.0)])
    canvas.show([tube(2.0)])
    assert len(scene.added) == 1
    assert {'batched_positions', 'batched_wxyzs', 'batched_scales', 'batched_colors'} <= set(
        scene.handles['/dlo/0'].changed)
    canvas.show([tube(2.0, number=4)])
    assert len(scene.added) == 2 and list(scene.handles) == ['/dlo/0']


def test_what_is_gone_is_removed(scene):
    canvas = Canvas(scene)
    canvas.show([tube(1.0), box()])
    canvas.show([box()])
    assert list(scene.handles) == ['/obstacle/0']
    assert list(canvas.items) == [('obstacle', 0)]


def test_bounds_hold_everything_but_texts(scene):
    canvas = Canvas(scene)
    assert canvas.bounds is None
    far = Primitive('note', 0, 'text', (1, 1, 1), text='far', pose=Pose((99, 0, 0), (0, 0, 0, 1)))
    canvas.show([tube(2.0), box(), far])
    np.testing.assert_allclose(canvas.bounds, [(-0.5, -0.5, -0.5), (2.0, 0.5, 2.0)])


@pytest.mark.parametrize('kind', KINDS)
def test_viser_takes_every_kind(kind):
    viser = pytest.importorskip('viser', reason='extra [view] is not installed')
    server = viser.ViserServer(host='localhost', port=18_300, verbose=False)
    try:
        points = np.arange(18.0).reshape(6, 3) if kind in (
            'line', 'segments', 'points', 'triangles') else np.eye(3)[:2] if (
            kind == 'arrow') else ()
        canvas = Canvas(server.scene)
        canvas.show([Primitive('a', 0, kind, (0.2, 0.4, 0.6), 0.5, points, size=(0.1, 0.1, 0.1),
                          text='a')])
        canvas.show([Primitive('a', 0, kind, (0.2, 0.4, 0.6), 1.0, points, size=(0.2, 0.1, 0.1),
                          text='b')])
        assert server.scene.get_handle_by_name('/a/0') is not None
        canvas.show([])
        assert server.scene.get_handle_by_name('/a/0') is None
    finally:
        server.stop()
