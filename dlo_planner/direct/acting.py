# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The Records of what acts on a Discretization: what of `energy.effects` a simulator offers."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dlo_planner.direct.history import History
from dlo_planner.energy.contact import Contact, Contacts, moved_scene
from dlo_planner.energy.distance import Scene
from dlo_planner.energy.effects import EFFECTS, Effects
from dlo_planner.energy.hold import Hold, no_hold
from dlo_planner.energy.inertia import no_anchor
from dlo_planner.energy.loads import Load
from dlo_planner.energy.potential import System, turned_system
from dlo_planner.energy.yielding import elastic_part
from dlo_planner.kernels import kernel
from dlo_planner.minimize.touching import touching_system
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.rod import Rod
from dlo_planner.ritz.record import Record

if TYPE_CHECKING:  # it imports this file
    from dlo_planner.direct.discretization import Discretization


def always(rod: Rod, pull: NDArray[np.float64]) -> Effects:
    """Return the Effects that act on every DLO: elasticity, and loads whose `pull` (N + 1, 3)."""
    known = {'elastic': elastic_part(rod), 'load': Load(pull)}
    return Effects(*[known.get(name) for name in EFFECTS])


def others(mesh: 'Discretization', layers: Record, scene: Scene) -> dict[str, Record]:
    """Return all others by their names, without a past: empty where there is no such thing."""
    return {'plastic': layers, 'anchor': no_anchor(), 'hold': free_end(mesh),
            'contact': Contact(scene, _contacts(mesh.spring, mesh.start, np.zeros(3)))}


def constraints(mesh: 'Discretization', scene: Scene, origin: NDArray[np.float64],
                history: History | None, far_end: FarEnd | None) -> dict[str, Record]:
    """Return contact and grip of the far end, their forces those of `history`, by their names."""
    past = mesh.start if history is None else history
    if far_end is None:
        return {'contact': Contact(scene, _contacts(mesh.spring, past, origin)),
                'hold': free_end(mesh)}
    return {'contact': Contact(scene, _contacts(mesh.held_spring, past, origin)),
            'hold': _held_end(mesh, far_end, origin, history)}


def free_end(mesh: 'Discretization') -> Hold:
    """Return the Hold of a free end."""
    return no_hold(mesh.hold_spring, mesh.hold_spring * mesh.lever**2)


def standing(mesh: 'Discretization', base: NDArray[np.float64], origin: NDArray[np.float64],
             history: History | None) -> System:
    """Return the System of a DLO with a free end that does not yield, its forces of `history`."""
    past = mesh.start if history is None else history
    return _standing(mesh.static, base, origin, mesh.spring, past.node_force,
                     *(past.points[name] for name in _OF_POINTS))


_OF_POINTS = ('element', 'obstacle', 'multiplier', 'fraction', 'anchor', 'normal', 'shear')


@kernel
def _standing(system, base, origin, spring, node, element, obstacle, multiplier, fraction, anchor,
              normal, shear):
    """Return the same System in another gripper, with Contacts of read-only arrays."""
    held = touching_system(system, Contacts(
        spring, node.copy(), element.copy(), obstacle.copy(), multiplier.copy(), fraction.copy(),
        anchor - origin, normal.copy(), shear.copy(), spring),
        moved_scene(system.effects.contact.scene, origin))
    return turned_system(held, base, origin)


def _held_end(mesh, far_end, origin, history):
    """Return the Hold of a FarEnd, with the forces of `history` if it held as many motions."""
    rows = far_end.held
    rows[:, :3] *= mesh.lever
    force = np.zeros(len(rows))
    if history is not None and history.hold.shape == force.shape:
        force = history.hold.copy()
    return free_end(mesh)._replace(
        target=far_end.pose.position - origin, axes=np.array(far_end.pose.rotation, order='C'),
        share=np.array(far_end.share), rows=rows, multiplier=force)


def _contacts(spring, history, origin):
    """Return the Contacts of a History, relative to a gripper at `origin` (3,); spring: N/m."""
    points = {name: values.copy() for name, values in history.points.items()}
    points['anchor'] -= origin
    return Contacts(spring, history.node_force.copy(), points['element'],
                    points['obstacle'], points['multiplier'], points['fraction'],
                    points['anchor'], points['normal'], points['shear'], spring)
