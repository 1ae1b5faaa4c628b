# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How near the links of an arm come to each other, by the convex hulls of their collision shapes.

Hulls are solid, and contain the shapes: what is clear of each other by its hulls is clear.
"""

from collections.abc import Callable, Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np

from dlo_planner.arm.chain import Chain
from dlo_planner.arm.pinocchio import pinocchio
from dlo_planner.arm.urdf import disabled_pairs, parsed, resolve_meshes
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats


class SelfCollision:
    """The pairs of links of a Chain that are looked at.

    Parameters
    ----------
    chain : Chain
    urdf : str
        See `Arm`.
    packages : sequence of str
        See `Arm`.
    srdf : str or None
        See `Arm`.
    clearance : float
        Clearance in m, nearer than which pairs touch.

    Attributes
    ----------
    missing
        Links without a shape to be looked at, with what is missing.
    pairs
        (p,) names of both links of each pair.
    """

    def __init__(self, chain: Chain, urdf: str, packages: Sequence[str], srdf: str | None,
                 clearance: float) -> None:
        pin, root = pinocchio(), parsed('urdf', urdf)
        self._chain = chain
        self.missing = tuple(resolve_meshes(root, packages))
        shapes = _hulls(chain.full, ElementTree.tostring(root, encoding='unicode'))
        _, self._shapes = pin.buildReducedModel(chain.named, shapes, chain.others, chain.standing)
        self._shapes.addAllCollisionPairs()  # but those of one body
        if not len(self._shapes.geometryObjects):
            self.missing = (*self.missing, 'no collision elements in the URDF')
        if srdf is None:
            self._keep(lambda one, other: not self._adjacent(one, other))
            near = self.distances(np.clip(0.0, chain.lower, chain.upper)) <= clearance
        else:
            disabled = disabled_pairs(srdf)
            self._keep(lambda one, other: frozenset((self._link(one), self._link(other)))
                       not in disabled)
            near = np.zeros(len(self._shapes.collisionPairs), dtype=bool)
        touching = iter(near.tolist())
        self._keep(lambda *_: not next(touching))
        self.pairs = [tuple(map(self._link, pair)) for pair in self._both()]
        self._levers = _levers(chain, self._shapes)

    def distances(self, positions: Floats) -> Floats:
        """Return the distance (p,) of each pair in m; below 0 they overlap."""
        pin, chain = pinocchio(), self._chain
        data = self._data
        pin.computeDistances(chain.model, chain.data, self._shapes, data,
                             chain.configuration(positions))
        return np.array([result.min_distance for result in data.distanceResults])

    def way(self, moved: Floats) -> float:
        """Return by how much, in m, a distance can change at most while joints move.

        Parameters
        ----------
        moved : ndarray, shape (m,)
            How far each one goes, back and forth counted twice, rad or m.
        """
        return float(np.abs(moved) @ self._levers)

    def _both(self) -> list[tuple[Any, Any]]:
        objects = self._shapes.geometryObjects
        return [(objects[one], objects[other]) for one, other in self._indices()]

    def _indices(self) -> list[tuple[int, int]]:
        return [(pair.first, pair.second) for pair in self._shapes.collisionPairs]

    def _link(self, shape: Any) -> str:
        return self._chain.link(shape.parentFrame)

    def _adjacent(self, one: Any, other: Any) -> bool:
        parents = self._chain.model.parents
        a, b = one.parentJoint, other.parentJoint
        return bool(a == b or a == parents[b] or b == parents[a])

    def _keep(self, wanted: Callable[[Any, Any], bool]) -> None:
        """Keep the pairs of shapes for which `wanted` holds."""
        kept = [indices for indices, both in zip(self._indices(), self._both(), strict=True)
                if wanted(*both)]
        self._shapes.removeAllCollisionPairs()
        for one, other in kept:
            self._shapes.addCollisionPair(pinocchio().CollisionPair(one, other))
        self._data = self._shapes.createData()


def _hulls(model: Any, urdf: str) -> Any:
    """Return pinocchio's GeometryModel of the collision elements, meshes as their convex hulls."""
    pin = pinocchio()
    try:
        shapes = pin.buildGeomFromUrdfString(model, urdf, pin.GeometryType.COLLISION)
    except Exception as error:  # Boost.Python: any may come
        raise InvalidTask(f'urdf: a collision shape cannot be read; {error}') from None
    for shape in shapes.geometryObjects:
        if hasattr(shape.geometry, 'buildConvexHull'):
            shape.geometry.buildConvexHull(True, 'Qt')
            shape.geometry = shape.geometry.convex
    return shapes


def _levers(chain: Chain, shapes: Any) -> Floats:
    """Return for each joint (m,) by how much it can move a point of a link at most, per unit.

    1 for one that slides; for one that turns, the longest way from it to a point beyond it, all
    links stretched out, sliding ones as far as they go.
    """
    model = chain.model
    beyond = np.zeros(model.njoints)
    for shape in shapes.geometryObjects:
        shape.geometry.computeLocalAABB()
        far = np.linalg.norm(shape.placement.act(shape.geometry.aabb_center))
        beyond[shape.parentJoint] = max(beyond[shape.parentJoint],
                                        far + shape.geometry.aabb_radius)
    ids = [model.getJointId(name) for name in chain.names]
    slides = {k: max(abs(low), abs(high)) for k, low, high, turning in zip(
        ids, chain.lower, chain.upper, chain.turning, strict=True) if not turning}
    for k in range(model.njoints - 1, 0, -1):
        way = np.linalg.norm(model.jointPlacements[k].translation) + slides.get(k, 0.0)
        beyond[model.parents[k]] = max(beyond[model.parents[k]], beyond[k] + way)
    return np.where(chain.turning, beyond[ids], 1.0)
