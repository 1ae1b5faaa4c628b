# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo: a chain of rigid pieces with springs between them, damped until it hangs still."""

import numpy as np

from benchmarks.peers.reference import BENDING, GRAVITY, LENGTH, WEIGHT

try:
    import mujoco
except ImportError:
    mujoco = None

NAME = 'MuJoCo (chain, damped until still)'
LADDER = (8, 16, 32, 64) if mujoco else ()
_STEP, _LONGEST, _STILL = 2e-3, 60.0, 1e-7


def prepare(case, n):
    """Return a function that returns (s, (n, 2) positions of the cells' ends), or None."""
    model = mujoco.MjModel.from_xml_string(_model(case, n))
    s = LENGTH / n * np.arange(1, n + 1)

    def run():
        data, shapes = mujoco.MjData(model), []
        for angle in case.angles:
            model.body_quat[1] = _turned(np.radians(angle))
            data.qvel[:] = 0
            if not _settled(model, data):
                return None
            shapes.append((s, np.array(data.site_xpos[:, [0, 2]])))
        return shapes

    return run


def _settled(model, data):
    """Run until nothing moves; return whether that came about."""
    for _ in range(int(_LONGEST / _STEP / 50)):
        mujoco.mj_step(model, data, 50)
        if np.abs(data.qvel).max() < _STILL and np.abs(data.qacc).max() < 1e3 * _STILL:
            mujoco.mj_forward(model, data)
            return True
    return False


def _turned(angle):
    return np.array([np.cos(angle / 2), 0.0, -np.sin(angle / 2), 0.0])


def _model(case, n):
    """Return the model: hinges in the middles of n cells; sites at the cells' ends."""
    h = LENGTH / n
    mass, rigid = WEIGHT / GRAVITY * h, 1e-3 * WEIGHT / GRAVITY * h**3
    damping = 0.6 * BENDING / h + 0.02 * case.tip_mass * GRAVITY * LENGTH
    text = end = ''
    for k in range(n):
        last = k == n - 1
        length = h / 2 if last else h
        own = mass * length / h
        tip = (f'<body pos="{length} 0 0"><inertial pos="0 0 0" mass="{case.tip_mass}" '
               f'diaginertia="{rigid} {rigid} {rigid}"/></body>'
               if last and case.tip_mass else '')
        text += (f'<body pos="{h / 2 if k == 0 else h} 0 0">'
                 f'<joint type="hinge" axis="0 -1 0" stiffness="{BENDING / h}" '
                 f'damping="{damping}"/><inertial pos="{length / 2} 0 0" mass="{own}" '
                 f'diaginertia="{rigid} {own * length**2 / 12 + rigid} '
                 f'{own * length**2 / 12 + rigid}"/><site pos="{h / 2} 0 0"/>{tip}')
        end += '</body>'
    return (f'<mujoco><option timestep="{_STEP}" integrator="implicitfast" '
            f'gravity="0 0 {-GRAVITY}"><flag contact="disable"/></option>'
            f'<worldbody><body>{text}{end}</body></worldbody></mujoco>')
