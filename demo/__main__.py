# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The demo: starts the node as a process of its own and has it do the main job over DDS."""

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from subprocess import Popen

import numpy as np
from scipy.spatial.transform import Rotation

from demo.cell import RADIUS, close_the_loop, installed
from demo.child import child
from demo.client import PlannerClient
from demo.figures import (
    Executed,
    save_moving,
    save_threading,
    save_turning,
    save_two,
)
from demo.measures import (
    GOAL,
    away_from,
    executed,
    missed,
    progress,
    received_residual,
    times_and_poses,
)
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.settings.yaml_files import config_file
from msg_helpers.trajectories import poses_from_path

# Benchmark C of the paper: 180 degrees in 10-degree steps and back, 36 positions after the first.
ANGLES = [*range(0, 181, 10), *range(170, -1, -10)]
JUMPS = [100, 80]
# Fig. 13: one cut-out, three bending rigidities, decreasing.
DIAMETERS = (2.0e-3, 1.5e-3, 1.15e-3)
TOO_SOFT = 1.0e-3  # falls sideways before its end is level
# Fig. 14: two cut-outs, whose centers count.
TWO_DIAMETER = 1.5e-3
TWO_GOALS = (GOAL, Pose.looking_along((0.3, 0.0, 0.95), (1.0, 0.0, 0.0)))
WAYPOINTS, DEEPEST = 40, 0.95
# Where the gripper is before the job begins: behind the sheet, aside, turned.
START, STANDOFF = Pose.looking_along((-1.3, 0.3, 1.1), (1.0, 0.2, 0.1)), 0.1
TOUCH = 0.05  # N, below which nobody minds
_DOMAINS = 100


@dataclass(frozen=True)
class Row:
    """One line of the closing table."""

    task: str
    asked: str
    came: str
    latency: float
    residual: float
    figures: str
    held: bool


def wire(diameter: float) -> Rod:
    """Return the paper's copper wire, 1 m, with another diameter in m."""
    return Rod.circular(1.0, diameter, 8960.0, 110e9, 0.34)


def planner_process(domain: int, directory: str) -> AbstractContextManager[Popen[bytes]]:
    """Return a context in which the planner node runs in a ROS domain of its own: its Popen."""
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain), 'ROS_LOG_DIR': str(directory)}
    return child('dlo_planner.ros.main', '--ros-args', '--params-file',
                 str(config_file('copper_wire')), '-p',
                 f'threading.waypoints:={WAYPOINTS}', '-p', f'threading.deepest:={DEEPEST}',
                 env=environment)


def gripper_at(degrees: float) -> Pose:
    """Return the gripper of benchmark C, turned up from level by an angle."""
    turn = Rotation.from_euler('y', -degrees, degrees=True)
    return Pose((0.0, 0.0, 1.0), turn.as_quat())


def turn_gripper(client: PlannerClient, folder: Path) -> Row:
    """Benchmark C: return its Row, having saved its picture."""
    here = DirectSimulator(wire(1e-3))
    reference = DirectSimulator(wire(1e-3), basis='local', n_elements=512)
    grippers = [gripper_at(angle) for angle in ANGLES]
    truth = reference.track(grippers)
    shapes: list[Floats] = []
    latencies, residuals, errors, jumps = [], [], [], []
    for number, (gripper, true, angle) in enumerate(zip(grippers, truth, ANGLES, strict=True)):
        path, seconds = client.shape_for(gripper)
        poses = poses_from_path(path)
        points = np.array([pose.position for pose in poses])
        if shapes and np.linalg.norm(points[-1] - shapes[-1][-1]) > 0.5:
            jumps.append(angle)
        shapes.append(points)
        latencies.append(seconds)
        residuals.append(received_residual(here, gripper, poses))
        if true.stability > 1e-3:  # a neutral shape is one of many: there is nothing to compare
            errors.append(np.linalg.norm(points - true.positions[::8], axis=1).max())
        progress('gripper turned', number + 1, len(grippers))
    save_turning(folder / 'benchmark_c.png', ANGLES, shapes)
    held = (max(errors) < 1e-3 and max(residuals) < 1e-8 and jumps == JUMPS)
    return Row('benchmark C', f'{len(grippers)} gripper poses', f'{len(shapes)} shapes',
               float(np.median(latencies)), max(residuals),
               f'off {1e3 * max(errors):.2f} mm at most, jumps at {jumps} deg', held)


def thread_wire(client: PlannerClient, folder: Path, diameter: float) -> Row:
    """Fig. 13 for one rigidity: return its Row, having saved its picture."""
    rod = wire(diameter)
    results = client.set_parameters(rod__diameter=diameter)
    if not all(result.successful for result in results):
        raise RuntimeError(f'rod.diameter = {diameter} was refused: {results[0].reason}')
    path, seconds = client.plan_threading(Pose.looking_along((-1.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
                                          GOAL)
    grippers = poses_from_path(path)
    depths = np.linspace(0.0, DEEPEST * rod.length, WAYPOINTS)
    simulator = DirectSimulator(rod)
    shapes, misses, angles, residuals = [], [], [], []
    for number, (gripper, depth) in enumerate(zip(grippers, depths, strict=True)):
        answer, _ = client.predict_shape(gripper)
        poses = poses_from_path(answer)
        shapes.append(np.array([pose.position for pose in poses]))
        residuals.append(received_residual(simulator, gripper, poses))
        # Independent of the plan: where does the directly simulated wire pass the cut-out?
        pierced = simulator.solve(gripper).at(rod.length - depth)
        misses.append(np.linalg.norm(pierced.position - GOAL.position))
        angles.append(np.linalg.norm(np.cross(pierced.direction, GOAL.direction)))
        progress(f'd = {1e3 * diameter:.2f} mm replayed', number + 1, len(grippers))
    stiffness = rod.stiffness[1]
    save_threading(folder / f'threading_EI_{1e3 * stiffness:.0f}_mNm2.png', stiffness, GOAL,
                   grippers, shapes,
                   InverseSimulator(simulator).insert(CutOut(GOAL), depths=depths).grippers)
    held = bool(max(misses) < 1e-6 and max(angles) < 1e-6 and max(residuals) < 1e-8)
    return Row(f'thread, EI {1e3 * stiffness:.1f} mN m2', f'{WAYPOINTS} waypoints',
               f'{len(grippers)} gripper poses', seconds, max(residuals),
               f'miss {max(misses):.0e} m, {max(angles):.0e} rad', held)


def thread_two(client: PlannerClient, folder: Path) -> Row:
    """Fig. 14: return its Row, having saved its picture; with what the node's own proof says."""
    rod = wire(TWO_DIAMETER)
    client.set_parameters(rod__diameter=TWO_DIAMETER)
    path, seconds = client.plan_two_cutouts(*TWO_GOALS)
    grippers = poses_from_path(path)
    depths = np.linspace(0.0, DEEPEST * rod.length, WAYPOINTS)
    tracked = DirectSimulator(rod).track(grippers)
    misses = []
    for shape, depth in zip(tracked, depths, strict=True):
        misses.append(np.linalg.norm(shape.at(rod.length - depth).position
                                     - TWO_GOALS[0].position))
        ahead = shape.positions_at(np.linspace(rod.length - depth, rod.length, 4001))
        if depth > 1.1 * np.linalg.norm(TWO_GOALS[1].position - TWO_GOALS[0].position):
            misses.append(np.linalg.norm(ahead - TWO_GOALS[1].position, axis=1).min())
    save_two(folder / 'two_cutouts.png', TWO_GOALS, grippers,
             [shape.positions for shape in tracked])
    proof = client.proof(path)
    moving, allowed = (float(proof[f'report {name} in motion [m]'])
                       for name in ('largest miss', 'tolerance'))
    # 4001 points are 0.25 mm apart
    held = bool(max(misses) < 1e-3 and proof['report'] == 'held' and moving <= allowed)
    return Row('two cut-outs', f'{WAYPOINTS} waypoints', f'{len(grippers)} gripper poses', seconds,
               max(shape.residual for shape in tracked),
               f'sampled miss {1e3 * max(misses):.2f} mm; in motion {1e3 * moving:.2f} mm promised',
               held)


def move_calmly(client: PlannerClient, folder: Path) -> Row:
    """From a pose of the gripper's own to the hole and through it, executed: return its Row.

    What was commanded is simulated here: the node's promise is compared with where the wire goes.
    """
    rod = wire(TWO_DIAMETER)
    # the robot shares this machine with the node, and may be late
    client.set_parameters(rod__diameter=TWO_DIAMETER, threading__standoff=STANDOFF,
                          incoming_command_timeout=0.5)
    client.shape_for(START)
    path, seconds = client.plan_threading(START, GOAL)
    early = client.trigger('execute')
    print(f'  execute at once: {early.message}')
    proof = client.proof(path)
    print(f'  proof: {proof["report"]}')
    times, grippers = times_and_poses(client.timed_for(path))
    commands = executed(client, times[-1], path)
    off = max(away_from(commands, grippers), default=np.inf)
    motion = DirectSimulator(rod).simulate(grippers, times[1])
    misses = [missed(shape) for shape in motion.shapes]
    promised, allowed = (float(proof[f'report {name} in motion [m]'])
                         for name in ('largest miss', 'tolerance'))
    save_moving(folder / 'calm_motion.png', GOAL, allowed, Executed(
        times, grippers, [shape.positions for shape in motion.shapes], misses))
    worst = np.nanmax(misses)
    held = bool(proof['report'] == 'held' and not early.success and motion.converged
                and promised <= allowed and worst <= 1.1 * promised and off < 1e-3
                and np.linalg.norm(commands[-1].position - grippers[-1].position) < 1e-9)
    return Row('start, thread, executed', f'{1e3 * allowed:.1f} mm in motion',
               f'{len(commands)} commands', seconds, max(shape.residual for shape in motion.shapes),
               f'{times[-1]:.1f} s; miss {1e3 * promised:.2f} mm promised, {1e3 * worst:.2f} mm '
               'simulated', held)


def thread_in_cell(client: PlannerClient, folder: Path) -> Row:
    """Have a wire that is not as stated threaded in a cell with a camera: return its Row."""
    came = close_the_loop(client, folder, progress)
    return Row('closed loop in a cell', f'hole of {1e3 * RADIUS:.0f} mm, unknown wire',
               f'{came.depth:.2f} of {came.wanted:.2f} m through', came.planned, float('nan'),
               f'miss {1e3 * came.miss:.1f} mm, {1e3 * came.promised:.1f} mm promised, by the data '
               f'sheet {1e3 * came.blind:.0f} mm; force {came.force:.2g} N',
               bool(came.threaded and came.force < TOUCH and came.miss <= came.promised))


def refuse_soft_wire(client: PlannerClient) -> Row:
    """Ask for what cannot be: a wire so soft that it falls sideways; return its Row."""
    client.set_parameters(rod__diameter=TOO_SOFT)
    path, seconds = client.plan_threading(Pose.looking_along((-1.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
                                          GOAL)
    stiffness = wire(TOO_SOFT).stiffness[1]
    return Row(f'thread, EI {1e3 * stiffness:.1f} mN m2', 'a refusal: unstable',
               'refused' if not path.poses else f'{len(path.poses)} gripper poses', seconds,
               float('nan'), 'reason: see the warning above', not path.poses)


def print_table(rows: Sequence[Row]) -> None:
    """Print what was asked, what came, latency and residual of every task."""
    head = ('task', 'asked', 'came', 'latency', 'residual', 'figures', 'held')
    lines = [(row.task, row.asked, row.came, f'{1e3 * row.latency:.1f} ms',
              '-' if np.isnan(row.residual) else f'{row.residual:.0e}', row.figures,
              'yes' if row.held else 'NO') for row in rows]
    widths = [max(len(line[i]) for line in [head, *lines]) for i in range(len(head))]
    for line in [head, tuple('-' * width for width in widths), *lines]:
        print('  '.join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)))


def main(args: Sequence[str] | None = None) -> int:
    """Run the demo; return 0 if everything held."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--output', type=Path, default=Path('demo_output'),
                        help='folder for the pictures (default: %(default)s)')
    # `ros2 launch` adds --ros-args, which are not for us
    folder = parser.parse_known_args(args)[0].output
    folder.mkdir(parents=True, exist_ok=True)
    domain = int(os.environ.get('ROS_DOMAIN_ID', 1 + os.getpid() % _DOMAINS))
    os.environ['ROS_DOMAIN_ID'] = str(domain)
    print(f'Starting the planner node as a process of its own (ROS domain {domain}) ...')
    with (tempfile.TemporaryDirectory() as logs, planner_process(domain, logs) as process):
        client = PlannerClient()
        try:
            if not client.wait_until_ready(600.0, lambda: process.poll() is None):
                print('The planner node did not come up.')
                return 1
            rows = [turn_gripper(client, folder)]
            rows += [thread_wire(client, folder, diameter) for diameter in DIAMETERS]
            rows.append(thread_two(client, folder))
            rows.append(thread_in_cell(client, folder) if installed() else
                        move_calmly(client, folder))
            rows.append(refuse_soft_wire(client))
        except TimeoutError as error:
            print(f'The planner node went silent: {error}')
            return 1
        finally:
            client.close()
    print()
    print_table(rows)
    print(f'\nPictures in {folder}: {", ".join(sorted(p.name for p in folder.glob("*.png")))}')
    held = all(row.held for row in rows)
    print('All of it held.' if held else 'Not all of it held.')
    return 0 if held else 1


if __name__ == '__main__':
    sys.exit(main())
