# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings in the layout of the DEFORM data set, made by MuJoCo: two grippers move a cable.

A chain of rigid pieces (`dlo_planner.cell.chain`, which shares no code with the simulators); its
first and last piece are as heavy as grippers, and springs with dampers draw them along. Recorded is
where they are, not where they are wanted, so that springs that give way do no harm. The far end may
turn about its axis.
"""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from benchmarks.deform_data import DT, Array, carried
from dlo_planner import Rod
from dlo_planner.cell.chain import Chain, add_chain, add_gripper, chain_of, set_springs
from dlo_planner.cell.truth import Truth

_STEP = 5e-4                  # s
_SETTLING, _CALM = 3.0, 5.0   # s, in which it comes to rest under a drag of so many 1/s
_HEAVY, _WIDE = 2.0, 0.03     # kg and m: mass of a gripper and radius of its gyration
_FIRM = 300.0                 # rad/s: natural frequency of what draws it along

Way = Callable[[float], tuple[Array, Rotation]]


@dataclass(frozen=True)
class _Scene:
    """MuJoCo's model and data of a cable; grippers: the indices of both bodies."""

    model: mujoco.MjModel
    data: mujoco.MjData
    chain: Chain
    grippers: tuple[int, int]


def by_mujoco(rod: Rod, held: Array, markers: int, cells: int = 32) -> Array:
    """Return a recording (frames, markers, 3), m, of a Rod that is moved by its grippers.

    Args:
        rod: whose radius gives the inertia about its axis
        held: (frames, 4, 3) wanted places of the clamped markers
    """
    scene = _built(rod, cells)
    ways = [_way(held[:, end], held[:, end + near] - held[:, end + near - 1])
            for end, near in ((1, 0), (2, 1))]
    _settle(scene, ways, held[0, 1])
    stub = float(np.linalg.norm(held[0, 1] - held[0, 0]))
    parts, frames = round(DT / _STEP), []
    for frame in range(len(held)):
        for part in range(parts if frame else 0):
            place = frame - 1 + (part + 1) / parts
            _advance(scene, [way(place) for way in ways], rod.damping[0])
        frames.append(_seen(scene, rod.length, stub, markers))
    return np.array(frames)


def _built(rod: Rod, cells: int) -> _Scene:
    spec, chain = mujoco.MjSpec(), chain_of(rod, Truth(), cells)
    spec.option.timestep, spec.option.gravity = _STEP, (0, 0, -9.81)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    first = add_gripper(spec, chain)
    add_chain(first, chain)
    last = spec.body(f'piece {cells - 1}')
    heavy = _HEAVY / chain.unit
    for body, along in ((first, 0.0), (last, 0.5 * chain.cell)):
        body.gravcomp, body.mass, body.ipos = 1, heavy, (along, 0, 0)
        body.inertia = np.full(3, heavy * _WIDE**2)
    last.inertia = (chain.inertias[-1, 0], *last.inertia[1:])
    model = spec.compile()
    model.dof_damping[6:] = rod.damping[1] * set_springs(model, chain)
    ends = (model.body('gripper').id, model.body(f'piece {cells - 1}').id)
    return _Scene(model, mujoco.MjData(model), chain, ends)


def _way(places: Array, along: Array) -> Way:
    """Return a function of the frame: place (3,), and the Rotation whose x axis is `along`."""
    frames = np.arange(len(places))
    turns = Rotation.concatenate(carried(along)).as_quat()
    turns[1:] *= np.cumprod(np.where(np.sum(turns[1:] * turns[:-1], axis=1) < 0, -1, 1))[:, None]
    spline = CubicSpline(frames, np.hstack([places, turns]))

    def way(place: float) -> tuple[Array, Rotation]:
        values = spline(place)
        return values[:3], Rotation.from_quat(values[3:])

    return way


def _settle(scene: _Scene, ways: list[Way], begin: Array) -> None:
    """Draw the far gripper from where it is when straight to where it begins, and wait."""
    data, (place, turn) = scene.data, ways[0](0.0)
    data.qpos[:3], data.qpos[3:7] = begin, turn.as_quat()[[3, 0, 1, 2]]
    mujoco.mj_forward(scene.model, data)
    far, steps = _pose(data, scene.grippers[1]), round(_SETTLING / _STEP)
    there = ways[1](0.0)
    swing = (there[1] * far[1].inv()).as_rotvec()
    for k in range(steps):
        x = min(1.0, 2 * k / steps)
        part = x * x * (3 - 2 * x)
        wanted = far[0] + part * (there[0] - far[0]), Rotation.from_rotvec(part * swing) * far[1]
        _advance(scene, [(place, turn), wanted], _CALM)


def _pose(data: mujoco.MjData, body: int) -> tuple[Array, Rotation]:
    return data.xipos[body].copy(), Rotation.from_matrix(data.xmat[body].reshape(3, 3))


def _advance(scene: _Scene, wanted: list[tuple[Array, Rotation]], drag: float) -> None:
    """Make a step; drag in 1/s takes velocity from all pieces but the grippers."""
    model, data = scene.model, scene.data
    arms = data.xipos - data.subtree_com[model.body_rootid]
    velocities = data.cvel[:, 3:] + np.cross(data.cvel[:, :3], arms)
    data.xfrc_applied[:, :3] = -drag * model.body_mass[:, None] * velocities
    for body, (place, turn) in zip(scene.grippers, wanted, strict=True):
        here, turned = _pose(data, body)
        off = np.concatenate([place - here, (turn * turned.inv()).as_rotvec()])
        speed = np.concatenate([velocities[body], data.cvel[body, :3]])
        pull = _FIRM**2 * off - 2 * _FIRM * speed
        pull[3:] *= _WIDE**2
        if body == scene.grippers[1]:
            axis = data.xmat[body].reshape(3, 3)[:, 0]
            pull[3:] -= (pull[3:] @ axis) * axis
        data.xfrc_applied[body] = _HEAVY / scene.chain.unit * pull
    mujoco.mj_step(model, data)


def _seen(scene: _Scene, length: float, stub: float, markers: int) -> Array:
    """Return the markers (markers, 3): on the pieces, two on each gripper."""
    data, (near, far) = scene.data, scene.grippers
    mujoco.mj_kinematics(scene.model, data)
    s = np.concatenate([[-stub], np.linspace(0, length, markers - 2), [length + stub]])
    cell = scene.chain.cell
    return np.array([_on_piece(data, near + int(np.clip(np.floor(one / cell + 0.5), 0, far - near)),
                               one, cell, near) for one in s])


def _on_piece(data: mujoco.MjData, body: int, s: float, cell: float, near: int) -> Array:
    """Return where (3,) a body has the arc length s: piece k begins at its joint, (k - 1/2) h."""
    begin = 0.0 if body == near else (body - near - 0.5) * cell
    return data.xpos[body] + (s - begin) * data.xmat[body].reshape(3, 3)[:, 0]
