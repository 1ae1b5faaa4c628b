# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO in the corner of a rectangular hole: it bears on two edges at once."""

import numpy as np
import pytest

from dlo_planner import CutOut, DirectSimulator, Pose, Rod, Sheet
from dlo_planner.energy.scene import build_scene, signed_distance

ROD = Rod(1.0, 0.03, 0.1, 0.08, radius=2e-3)
WIDE, HIGH = 0.04, 0.03


def around(place, thickness, turned=0.0):
    """Return a Sheet with a rectangular hole at a place, normal along x."""
    attitude = (np.sin(turned / 2), 0, 0, np.cos(turned / 2))
    return Sheet.around(CutOut(Pose(place, attitude), width=WIDE, height=HIGH), 0.4, 0.4,
                        thickness)


@pytest.mark.every(5)
@pytest.mark.parametrize('turned', [0.0, 0.4])
@pytest.mark.parametrize('signs', [(1, 1), (-1, 1)])
@pytest.mark.parametrize('thickness', [0.0, 0.002, 0.01])
def test_pressed_into_a_corner_it_bears_on_both_edges(thickness, signs, turned):
    alone = DirectSimulator(ROD, basis='local').solve(Pose.identity())
    place = alone.at(0.62).position
    direct = DirectSimulator(ROD, basis='local', obstacles=[around(place, thickness, turned)])
    way = [Pose((0, k * 0.012 * signs[0], k * 0.012 * signs[1]), (0, 0, 0, 1)) for k in range(6)]
    shapes = direct.track(way, initial=alone)
    assert all(shape.converged for shape in shapes)
    edges = np.array([[np.cos(turned), np.sin(turned)], [-np.sin(turned), np.cos(turned)]])
    last = shapes[-1]
    pushes = np.array([edges @ contact.vector[1:] for contact in last.contacts]).sum(axis=0)
    directions = {int(np.argmax(np.abs(edges @ one.normal[1:]))) for one in last.contacts}
    assert directions == {0, 1}
    assert (np.abs(pushes) > 1e-3).all()
    dense = last.positions_at(np.linspace(0.5, 0.7, 2000)) - place
    room = (np.array([WIDE, HIGH]) / 2 - np.abs(dense[:, 1:] @ edges.T)).min(axis=1)
    beside = np.maximum(np.abs(dense[:, 0]) - thickness / 2, 0)
    assert np.hypot(np.maximum(room, 0), beside).min() > ROD.radius - 5e-6


@pytest.mark.parametrize('holes', [1, 2, 3])
def test_layers_with_slots_are_together_the_sheet(holes):
    rng = np.random.default_rng(holes)
    cutouts = [CutOut(Pose((0, y, 0.02 * y), (np.sin(a), 0, 0, np.cos(a))), width=0.1, height=0.06)
               for y, a in zip((-0.3, 0.0, 0.3)[:holes], (0.0, 0.3, 0.6), strict=False)]
    cutouts.append(CutOut(Pose((0, 0, 0.3), (0, 0, 0, 1)), radius=0.05))
    sheet = Sheet(Pose.identity(), 1.0, 1.0, 0.0, cutouts)
    scene = build_scene([sheet], 1e-3)
    for x in rng.uniform((-0.1, -0.6, -0.6), (0.1, 0.6, 0.6), size=(400, 3)):
        least = min(signed_distance(scene, o, x, np.empty(3), np.empty((3, 3)))
                    for o in range(scene.kind.size))
        assert least == pytest.approx(to_sheet(x, cutouts), abs=1e-9)


def to_sheet(x, cutouts):
    """Return the distance of a point from a plate of 1 x 1 m at x = 0 with holes."""
    border = np.abs(x[1:]) - 0.5
    outside = np.hypot(*np.maximum(border, 0)) + min(border.max(), 0)
    aside = outside
    for cutout in cutouts:
        local = (cutout.pose.rotation.T @ (x - cutout.pose.position))[1:]
        if cutout.radius is not None:
            room = cutout.radius - np.hypot(*local)
        else:
            room = (np.array([cutout.width, cutout.height]) / 2 - np.abs(local)).min()
        aside = max(aside, room)
    return np.hypot(max(aside, 0), x[0])
