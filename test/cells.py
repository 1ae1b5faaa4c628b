# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What stands in a cell for tests: one of each kind, and whether two scenes are the same."""

from dataclasses import fields

import numpy as np
import solids

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    Cylinder,
    Ellipsoid,
    Hull,
    Mesh,
    Plane,
    Pose,
    Sheet,
    Sphere,
)


def rolled(place, roll):
    """Return a level pose that is rolled about its x axis, rad."""
    return Pose(place, (np.sin(roll / 2), 0, 0, np.cos(roll / 2)))


AT = Pose.looking_along((0.3, 0.2, 0.5), (1, 0.4, 0.2)).compose(rolled((0, 0, 0), 0.3))


def in_sheet(y, z, roll=0.0, **sizes):
    """Return a cut-out of a sheet at AT."""
    return CutOut(AT.compose(rolled((0, y, z), roll)), **sizes)


def one_of_each():
    """Return obstacles of all kinds, with friction and without, two of them one object."""
    points = np.random.default_rng(3).normal(size=(20, 3)) * 0.1
    return (
        Plane((0, 0, -0.1), (0.1, 0, 1), 0.3, name='floor'), Sphere((0.1, 0.2, 0.3), 0.05),
        Capsule((0, 0, 0), (0.1, 0.2, 0.3), 0.02, name='bar/0'),
        Capsule((0.1, 0.2, 0.3), (0.3, 0.2, 0.3), 0.02, name='bar/1'),
        Cylinder((0, 0, 0), (0.1, -0.2, 0.3), 0.02, 0.1, name='a rod'),
        Box(AT, (1, 2, 0.1), 0.5, name='table'), Ellipsoid(AT, (0.1, 0.2, 0.05), name='egg'),
        Sheet(AT, 0.4, 0.3, 0.004, (in_sheet(0.05, 0.03, radius=0.01),
                                    in_sheet(-0.1, -0.05, 0.4, width=0.03, height=0.02)), 0.2,
              name='panel 1'),
        Sheet(AT, 1.0, 0.8, 0.0, name='paper'),
        Mesh(*solids.torus(0.1, 0.02, 12, 8), AT, 0.1, False, name='ring'),
        Hull(points, AT, name='stone'))


def difference(one, other, within):
    """Return where two values of one kind differ by more than `within`, '' if nowhere."""
    if type(one) is not type(other):
        return f'{one} {other}'
    for item in fields(one):
        a, b = getattr(one, item.name), getattr(other, item.name)
        if item.name == 'cutouts':
            found = [difference(x, y, within) for x, y in zip(a, b, strict=True)]
            if any(found):
                return str(found)
        elif isinstance(a, Pose):
            if max(np.abs(a.position - b.position).max(),
                   np.abs(a.rotation - b.rotation).max()) > within:
                return f'{item.name}: {a} {b}'
        elif isinstance(a, str | bool | None):
            if a != b:
                return f'{item.name}: {a} {b}'
        elif np.shape(a) != np.shape(b) or np.abs(np.asarray(a) - b).max() > within:
            return f'{item.name}: {a} {b}'
    return ''
