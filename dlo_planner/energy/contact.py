"""Contact with obstacles: the DLO's surface stays outside, and friction resists its sliding.

Every node is watched, and the nearest point inside an element wherever it comes nearer to an
obstacle than the nodes do. Each such point has a gap g to each obstacle and a multiplier m >= 0:
the augmented Lagrangian  (max(0, m - k g)^2 - m^2) / (2 k)  pushes with the force max(0, m - k g);
the minimiser's outer loop moves m until the gaps under force are zero.

The nearest point slides along the DLO as the shape changes, which the second derivative accounts
for: d2g - (d(dg/ds))^2 / g_ss.

Friction is `energy.friction`'s; each point of contact that rubs has a point of friction of its own.
"""

import numpy as np

from dlo_planner.energy.distance import signed_distance
from dlo_planner.energy.friction import add_friction
from dlo_planner.kernels import kernel
from dlo_planner.ritz.kinematics import point_inside
from dlo_planner.ritz.record import Record, makes

_END = 1e-12  # of an element: nearer to its end a point is the end


class Contacts(Record):
    """Points where the DLO may touch, and what is known of their forces.

    Attributes:
        stiffness: k, N/m
        node: (M, N + 1) multipliers of nodes against obstacles, N
        element: (C,) ascending, of points inside elements; obstacle: (C,) the one they are nearest
            to, or -1 - o for a point of friction on obstacle o
        multiplier: (C,) m, or the limit of the friction force, N

        of points of friction alone
        fraction: (C,) of the element; 1 for a node, its end, less for what is inside
        anchor: (C, 3) where it sticks, m, relative to the gripper; what is across `normal` counts
        normal: (C, 3) of the obstacle there
        shear: (C, 3) its multiplier, N, across the normal, against the friction on the DLO
        grip: its stiffness, N/m
    """

    stiffness: float
    node: np.ndarray
    element: np.ndarray
    obstacle: np.ndarray
    multiplier: np.ndarray
    fraction: np.ndarray
    anchor: np.ndarray
    normal: np.ndarray
    shear: np.ndarray
    grip: float


@makes(Contacts)
@kernel
def _new_contacts(stiffness, node, element, obstacle, multiplier, fraction, anchor, normal, shear,
                  grip):
    return Contacts(stiffness, node, element, obstacle, multiplier, fraction, anchor, normal, shear,
                    grip)


@kernel
def add_contacts(scene, contacts, lengths, strains, rotations, positions, pull, attached):
    """Add the forces of all contacts to `pull` and `attached`; return their potential in J."""
    energy = 0.0
    k = contacts.stiffness
    x, normal, bend = np.empty(3), np.empty(3), np.empty((3, 3))
    frame = np.empty((3, 3))
    attached.sprung[:] = False
    for o in range(scene.kind.size):
        node = 1
        while node < positions.shape[0]:
            for i in range(3):
                x[i] = scene.origin[i] + positions[node, i]
            gap = signed_distance(scene, o, x, normal, bend) - scene.radius
            force = contacts.node[o, node] - k * gap
            if force > 0.0:
                energy += 0.5 * force * force / k
                if not attached.sprung[node]:
                    attached.spring[node] = 0.0
                    attached.sprung[node] = True
                for i in range(3):
                    pull[node, i] -= force * normal[i]
                    for j in range(3):
                        attached.spring[node, i, j] += (k * normal[i] * normal[j]
                                                        - force * bend[i, j])
            energy -= 0.5 * contacts.node[o, node] ** 2 / k
            node = next_touching(lengths, contacts.node[o], node, gap)
    for c in range(contacts.element.size):
        e, o = contacts.element[c], contacts.obstacle[c]
        attached.force[c] = 0.0
        attached.matrix[c] = 0.0
        if o < 0:
            energy += add_friction(contacts, c, lengths, strains, rotations, positions, attached)
            continue
        gap, fraction = nearest_inside(scene, o, e, lengths, strains, rotations, positions,
                                       normal, bend)
        attached.fraction[c] = fraction
        point_inside(lengths, strains, rotations, positions, e, fraction, frame, x)
        force = contacts.multiplier[c] - k * gap
        if force > 0.0:
            energy += 0.5 * force * force / k
            _push(c, force, k, strains[e], frame, normal, bend, attached)
        energy -= 0.5 * contacts.multiplier[c] ** 2 / k
    return energy


@kernel
def next_touching(lengths, multiplier, node, gap):
    """Return the next node after `node` that may touch an obstacle, N + 1 if none does.

    No node is nearer to it by more than the DLO between them is long. Far obstacles cost nothing.

    Args:
        multiplier: (N + 1,) of the nodes; one that has some is never left out
        gap: m, of `node`
    """
    last = lengths.size
    way = 0.0
    while node <= last:
        if node < last:
            way += lengths[node]
        node += 1
        if way >= gap or node <= last and multiplier[node] > 0.0:
            break
    return node


@kernel
def nearest_inside(scene, o, e, lengths, strains, rotations, positions, normal, bend):
    """Return gap and fraction of the point of element e that is nearest to obstacle o.

    Fills normal (3,) and bend (3, 3) of the distance there. A safeguarded Newton iteration for
    the zero of dg/ds; the nearest end of the element if there is none inside.
    """
    rotation, x = np.empty((3, 3)), np.empty(3)
    low, high, fraction = 0.0, 1.0, 0.5
    for iteration in range(60):
        point_inside(lengths, strains, rotations, positions, e, fraction, rotation, x)
        for i in range(3):
            x[i] += scene.origin[i]
        gap = signed_distance(scene, o, x, normal, bend) - scene.radius
        slope, curve = along_the_dlo(normal, bend, rotation, strains[e])
        if slope > 0.0:
            high = fraction
        else:
            low = fraction
        if high - low < 1e-15:
            break
        target = fraction - slope / (curve * lengths[e]) if curve > 0.0 else -1.0
        if iteration == 0 and curve > 0.0 and not 0.0 < target < 1.0:
            target = 0.0 if target <= 0.0 else 1.0  # look at the end itself
        elif not low < target < high:
            target = 0.5 * (low + high)
        if abs(target - fraction) < 1e-15:
            break
        fraction = target
    if fraction < _END or fraction > 1.0 - _END:
        fraction = 0.0 if fraction < _END else 1.0
    return gap, fraction


@kernel
def along_the_dlo(normal, bend, rotation, strain):
    """Return dg/ds and d2g/ds2 of the gap along the DLO, where its frame is `rotation`."""
    slope = curve = 0.0
    for i in range(3):
        # t' = kappa_b n - kappa_n b
        change = strain[2] * rotation[i, 1] - strain[1] * rotation[i, 2]
        slope += normal[i] * rotation[i, 0]
        curve += normal[i] * change
        for j in range(3):
            curve += rotation[i, 0] * bend[i, j] * rotation[j, 0]
    return slope, curve


@kernel
def _push(c, force, k, strain, rotation, normal, bend, attached):
    """Write the force and the stiffness of a contact where the DLO's frame is `rotation`."""
    matrix = attached.matrix[c]
    for i in range(3):
        attached.force[c, i] = -force * normal[i]
        for j in range(3):
            matrix[3 + i, 3 + j] = k * normal[i] * normal[j] - force * bend[i, j]
    if not 0.0 < attached.fraction[c] < 1.0:
        return  # at an end the point does not slide
    _, curve = along_the_dlo(normal, bend, rotation, strain)
    if curve <= 0.0:
        return
    lever = np.empty(6)  # change of dg/ds by rotation and displacement of the frame there
    for i in range(3):
        first, second = (i + 1) % 3, (i + 2) % 3
        lever[i] = rotation[first, 0] * normal[second] - rotation[second, 0] * normal[first]
        lever[3 + i] = (bend[i, 0] * rotation[0, 0] + bend[i, 1] * rotation[1, 0]
                        + bend[i, 2] * rotation[2, 0])
    for i in range(6):
        for j in range(6):
            matrix[i, j] += force / curve * lever[i] * lever[j]
