# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The physics engine; this package alone needs it."""

try:
    import mujoco
except ImportError as error:
    raise ImportError('dlo_planner.cell needs MuJoCo: pip install dlo_planner[cell]') from error

if not hasattr(mujoco.mjtIntegrator, 'mjINT_DISCRETE'):
    raise ImportError(f'dlo_planner.cell needs mujoco >= 3.13, this is {mujoco.__version__}: its '
                      'older integrators do not take stiff springs into account in contacts')

# It would write a file wherever it is; the plant sees by itself what goes wrong.
mujoco.set_mju_user_warning(lambda message: None)

__all__ = ['mujoco']
