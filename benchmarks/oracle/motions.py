# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cases with inertia: free, beside what is never touched, in contact, held, yielding."""

import numpy as np

from benchmarks.oracle.answers import FACTOR, Answer, Scale
from benchmarks.oracle.contacts import scene, stiff_rod
from benchmarks.oracle.shapes import GRIPS
from dlo_planner import DirectSimulator, FarEnd, Plane, Pose, Rod, Sphere

FREE, TOUCHING = 1e-5, 1e-4  # of the length: a hundredth and a tenth of the default tolerance
_PLACES = np.arange(1, 10) / 9


def of_motion(motion, rod, loose=FREE, estimate=False):
    """Return the Answer of a Motion."""
    answer, scale = Answer(), Scale.of(rod)
    answer.say('verdict', motion.status if motion.status != 'complete' or motion.converged
               else 'not converged')
    answer.put('instants', len(motion), 0.0)
    if not motion.converged:
        answer.put('until', motion.times[-1], 0.02 * motion.times[-1] + 1e-9)
        return answer
    last, middle = motion.shapes[-1], motion.shapes[len(motion) // 2]
    answer.put('positions', last.positions_at(_PLACES * rod.length), loose * scale.length)
    answer.put('tip halfway', middle.positions[-1], loose * scale.length)
    moved = max(motion.kinetic_energy.max() + np.ptp(motion.potential_energy), 1e-9 * scale.energy)
    speed = max(np.abs(motion.velocities).max(), 1e-9)
    answer.put('tip velocity', motion.velocities[-1, -1], 10 * loose * speed)
    for name in ('kinetic_energy', 'potential_energy', 'work'):
        answer.put(name, getattr(motion, name)[-1], 10 * loose * moved)
    answer.put('dissipated', motion.dissipated[-1], 10 * loose * moved)
    wrench = np.array(last.gripper_wrench)
    wrench[3:] /= scale.length
    answer.put('gripper_wrench', wrench, 100 * loose * max(scale.force, np.abs(wrench).max()))
    touching = sorted({contact.obstacle for contact in middle.contacts})
    answer.say('touches halfway', touching)
    if estimate:
        answer.put('error_estimate', motion.error_estimate[-1], 1e-7 * scale.length, FACTOR)
    return answer


def swung(given, rod, count, quick=0.3):
    """Return poses of a gripper that is moved and turned smoothly, and the time step (s)."""
    own = np.sqrt(rod.length / 9.81)
    start = given.turned((0, 0, 0), given.rng.normal(size=3) * (0.2, 0.5, 3))
    away, turn = quick * rod.length * given.direction(), quick * 2 * given.direction()
    parts = 0.5 * (1 - np.cos(np.pi * np.arange(count) / (count - 1) * given.rng.uniform(1, 3)))
    return [given.way(start, part * away, part * turn, 1)[0] for part in parts], 0.08 * own


def free(given):
    """Swing a DLO that hangs freely, some without damping."""
    rod = given.rod((0.5, 100), damping=(0.0, 0.0) if given.number % 2 else (0.2, 2e-3))
    how = ({'basis': 'local', 'n_elements': 24}, {'n_elements': 32, 'n_terms': 6},
           {})[given.number % 3]
    poses, dt = swung(given, rod, 15)
    options = {'integrator': 'paper'} if given.number % 8 == 7 else {}
    motion = DirectSimulator(rod, **how).simulate(poses, dt, **options)
    if given.number % 8 == 3:
        motion = DirectSimulator(rod, **how).simulate(poses[-1:] * 5, dt, motion)
    return of_motion(motion, rod, estimate=given.number % 4 == 0)


def idle(given):
    """Swing a DLO beside obstacles that are never touched."""
    rod = stiff_rod(given, damping=(0.1, 1e-3))
    around = [Plane((0, 0, -1.6), (0, 0, 1)), Sphere((0, 0, 2.0), 0.4)][:1 + given.number % 2]
    direct = DirectSimulator(rod, basis='local', n_elements=24, obstacles=around)
    poses, dt = swung(given, rod, 12)
    return of_motion(direct.simulate(poses, dt), rod)


def touching(given):
    """Bring a DLO down onto obstacles, and over them, with inertia."""
    friction = 0.3 if given.number % 3 == 2 else 0.0
    rod, obstacles, poses = scene(given, friction, rod=stiff_rod(given, damping=(0.5, 5e-3)))
    direct = DirectSimulator(rod, basis='local', n_elements=24, obstacles=obstacles)
    return of_motion(direct.simulate(poses, 0.1), rod, TOUCHING)


def held(given):
    """Move both ends of a DLO."""
    rod = given.rod((1, 100), damping=(0.2, 2e-3))
    direct = DirectSimulator(rod, basis='local', n_elements=24)
    poses, dt = swung(given, rod, 12, 0.15)
    away = poses[0].compose(Pose((0.7 * rod.length, 0, 0), (0, 0, 0, 1)))
    end = given.pose(away.position, away.quaternion)
    grip = GRIPS[given.number % 4]
    ends = [FarEnd(pose, grip) for pose in given.way(
        end, 0.1 * rod.length * given.direction(), 0.2 * given.direction(), 11)]
    return of_motion(direct.simulate(poses, dt, far_ends=[FarEnd(end, grip), *ends]), rod)


def yielding(given):
    """Swing a DLO that yields in some, and never in others."""
    rod = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34, hardening=0.05, damping=(0.1, 1e-3),
                       yield_stress=given.between(30e6, 80e6) if given.number % 3 else 1e10)
    direct = DirectSimulator(rod, basis='local', n_elements=24)
    poses, dt = swung(given, rod, 12, 0.5)
    return of_motion(direct.simulate(poses, dt), rod)


def held_touching(given):
    """Move both ends of a DLO down onto a floor."""
    rod = stiff_rod(given, damping=(0.5, 5e-3))
    start, end = given.turned((0, 0, 0), (0, 0.4, 0)), given.turned((0.7, 0, 0), (0, -0.4, 0))
    low = DirectSimulator(rod).solve(start, far_end=FarEnd(end)).positions[:, 2].min()
    floor = Plane((0, 0, low - rod.radius - 0.01), (0, 0, 1), 0.2 * (given.number % 2))
    direct = DirectSimulator(rod, basis='local', n_elements=24, obstacles=[floor])
    down = (0.02, 0.01, -0.05)
    ends = [FarEnd(pose) for pose in (end, *given.way(end, down, (0, 0, 0), 7))]
    poses = [start, *given.way(start, down, (0, 0, 0), 7)]
    return of_motion(direct.simulate(poses, 0.08, far_ends=ends), rod, TOUCHING)
