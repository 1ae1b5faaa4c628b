# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Good examples of every public type, and of every argument by its name."""

from dataclasses import replace
from functools import cache

import numpy as np

import dlo_planner.identify
import dlo_planner.penalties
import dlo_planner.scene
import dlo_planner.tasks
from dlo_planner import (
    Box,
    Capsule,
    ClosedLoop,
    CutOut,
    Cylinder,
    DirectSimulator,
    Ellipsoid,
    FarEnd,
    Hold,
    HoldContact,
    Hull,
    Insert,
    InverseSimulator,
    LayOnLine,
    Limits,
    Mesh,
    Minimize,
    Observer,
    Plane,
    PointLoad,
    Pose,
    Rod,
    Sheet,
    SlideContact,
    Sphere,
    Thread,
    ThreadSequence,
    ThreadTwo,
    Trajectory,
    Uncertainty,
    Workspace,
    fit_rod,
    replay,
    robustness,
    solve_many,
)
from dlo_planner.arm.joint_trajectory import JointTrajectory
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.identify import CorrectedTrajectory, Observation, ObservedMotion, correct
from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.parallel import CellGrid, capability_map, which_grasp
from dlo_planner.penalties import (
    AwayFrom,
    BentAtMost,
    DirectionAt,
    FrameAt,
    GripperNear,
    InHole,
    KeepTangent,
    PositionAt,
    Through,
    minimize_penalty,
)
from dlo_planner.rods import GraspedInside, Piecewise, Section
from dlo_planner.scene import Scene
from dlo_planner.tasks import (
    Approach,
    Carry,
    Clip,
    Fork,
    InsertPlug,
    MoveTo,
    Peg,
    PlanStatus,
    Plug,
    Requirements,
    Route,
    ThreadInGrasps,
)

# For those who write tasks and penalties of their own: no values that are given or got.
_OWN = {'Fitting', 'PlanBuilder', 'PlanContext', 'Sensitivity', 'Task', 'Value', 'Waypoint', 'put',
        'read_task', 'task_from_yaml', 'task_to_yaml', 'threading_of', 'waypoint_at', 'write_task'}
PUBLIC = {name: getattr(module, name)
          for module in (dlo_planner, dlo_planner.tasks, dlo_planner.penalties,
                         dlo_planner.identify, dlo_planner.scene)
          for name in module.__all__ if name not in _OWN}
LEVEL = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
DEPTHS = (0.0, 0.2)
FAR = CutOut(Pose.looking_along((0.6, 0, 1), (1, 0, 0)), radius=0.2)
CORNERS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
SIDES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))


@cache
def values():
    """Return a dict of examples by the name of their class."""
    wire = Rod(1.0, 0.1, 1.0, 0.7, radius=0.01)
    soft = Rod(1.0, 0.1, 1.0, 0.7, radius=0.01, yield_curvature=0.3, hardening=0.1)
    hole = CutOut(Pose.looking_along((0.4, 0, 1), (1, 0, 0)), radius=0.2)
    floor = Plane((0, 0, 0.9), (0, 0, 1), 0.2)
    simulator = DirectSimulator(wire, n_elements=8, n_terms=4)
    shape = simulator.solve(LEVEL)
    inverse = InverseSimulator(simulator)
    plan = inverse.thread(hole, depths=DEPTHS)
    touching = DirectSimulator(wire, n_elements=8, n_terms=4, obstacles=[floor])
    bar = Capsule((0.5, -1, 0.85), (0.5, 1, 0.85), 0.05)
    over_bar = DirectSimulator(wire, n_elements=16, n_terms=8, obstacles=[bar])
    grasped = GraspedInside(soft, 0.4, n_elements=8, n_terms=4)
    examples = [
        LEVEL, wire, hole, floor, simulator, shape, inverse, plan, grasped,
        touching.track([LEVEL])[0].contacts[0], Section.of('round', 0.01, 0.01, 1e9, 0.3),
        Sphere((1, 0, 0), 0.1), Capsule((1, 0, 0), (2, 0, 0), 0.1),
        Cylinder((1, 0, 0), (2, 0, 0), 0.1), Box(LEVEL, (1, 2, 3)), Ellipsoid(LEVEL, (1, 2, 3)),
        PointLoad((0.0, 0.0, -1.0)), Piecewise(np.cos, (0.5,)),
        Mesh(CORNERS, SIDES), Hull(CORNERS),
        Sheet.around(hole, 1.0, 1.0), Scene([floor, Sheet.around(hole, 1.0, 1.0, name='lid')]),
        FarEnd(LEVEL), Hold(LEVEL, s=0.5), simulator.simulate([LEVEL] * 3, 0.01),
        replay(simulator, plan), Limits(), Workspace((-9, -9, -9), keep_out=[floor]),
        shape.modes(2), solve_many(touching, [LEVEL]),
        Uncertainty(length=0.01), robustness(simulator, plan, Uncertainty(length=0.01), samples=2),
        PositionAt(0.5, (0.4, 0, 1)), DirectionAt(0.5, (1, 0, 0)), GripperNear(LEVEL),
        FrameAt(0.5, LEVEL), InHole(hole, 0.002, 0.001),
        KeepTangent(0.0, 0.5, (1, 0, 0)), Through((0.4, 0, 1)), AwayFrom((floor,), 0.1),
        BentAtMost(1.0),
        Observation(LEVEL, shape.positions[1:], shape.s[1:]), Trajectory(plan),
        ObservedMotion([LEVEL] * 3, 0.01, [0.0, 0.02], np.ones((2, 1, 3)), [1.0]),
        minimize_penalty(simulator, PositionAt(1.0, (0.9, 0, 0.9)), LEVEL)]
    seen = examples[-4]
    examples.append(fit_rod(wire, [seen], n_elements=8, n_terms=4))
    observer = Observer(simulator, Uncertainty(0.05, gripper_position=1e-3), cutout=1e-3)
    estimate = observer.update(observer.begin(), seen)
    contact = Pose((0.5, 0, 0.9), (0, 0, 0, 1))
    examples += [Thread(hole, DEPTHS), ThreadTwo(hole, FAR, DEPTHS), Insert(hole, DEPTHS),
                 ThreadSequence((hole, FAR), depths=DEPTHS), Approach(hole, plan.shapes[0], 0.05),
                 HoldContact(contact, 0.5), SlideContact(contact, [0.5]), Requirements(),
                 Minimize(PositionAt(1.0, (0.9, 0, 0.9))), MoveTo([LEVEL]), Carry(LEVEL),
                 Clip(LEVEL), Fork(LEVEL), Peg(LEVEL),
                 Route([Fork(Pose((0.9, 0.0, 1.0), (0, 0, 0, 1)), slip=1.0)]),
                 LayOnLine(LEVEL), Plug(0.05, 0.01, 0.02),
                 InsertPlug(LEVEL, Plug(0.05, 0.01, 0.02)), ThreadInGrasps(
                     hole, 0.15, Pose((-0.4, 0.0, 1.0), LEVEL.quaternion), hold_at=0.8)]
    examples += [observer, estimate, estimate.miss(plan), correct(estimate, plan), ClosedLoop(0.01),
                 CorrectedTrajectory(Trajectory(plan, tolerance=np.inf), [1.0, 0.5, 0.1])]
    return {type(one).__name__: one for one in examples} | {
        name: InverseSimulator(over_bar) for name in (
            'InverseSimulator.hold_contact', 'InverseSimulator.slide_contact')}


@cache
def arguments():
    """Return a dict of examples by the name of the argument, or by 'callable.argument'."""
    import message_specimens  # noqa: PLC0415  (values serve on a machine without ROS, too)

    known = values()
    wire, simulator, hole, shape = (known[name] for name in (
        'Rod', 'DirectSimulator', 'CutOut', 'Shape'))
    plain = {name: getattr(shape, name) for name in (
        'positions', 'frames', 'element_strains', 'energy', 'elastic_energy', 'gripper_wrench',
        'residual', 'stability', 'iterations')}
    return plain | {
        # what it is, where it is
        'rod': wire, 'length': 1.0, 'mass_per_length': 0.1, 'bending_stiffness': 1.0,
        'torsional_stiffness': 0.7, 'diameter': 0.01, 'outer_diameter': 0.02,
        'inner_diameter': 0.01, 'width': 0.3, 'thickness': 0.01, 'height': 0.2, 'density': 1000.0,
        'youngs_modulus': 1e9, 'shear_modulus': 4e8, 'poisson_ratio': 0.3, 'kind': 'round',
        'half_n': 0.01, 'half_b': 0.01, 'yield_stress': 1e6,
        'pose': LEVEL, 'position': (0.0, 0.0, 1.0), 'quaternion': (0.0, 0.0, 0.0, 1.0),
        'to': LEVEL, 'MoveTo.far_ends': (), 'Trajectory.arm.name': 'gripper',
        'rotation': np.eye(3), 'matrix': np.eye(4), 'direction': (1.0, 0.0, 0.0), 'other': LEVEL,
        'value': LEVEL, 'point': (0.0, 0.0, 0.0), 'normal': (0.0, 0.0, 1.0), 'center': (0, 0, 0),
        'radius': 0.01, 'start': LEVEL, 'end': (0.0, 0.0, 0.0), 'size': (1.0, 1.0, 1.0),
        'half_axes': (1.0, 0.5, 0.5),
        'vertices': CORNERS, 'faces': SIDES, 'smooth': True, 'unit': 'mm', 'Hull.points': CORNERS,
        'Mesh.read.path': 'tetrahedron.obj', 'Scene.read.path': 'tetrahedron.obj',
        'joints': {}, 'Scene.write.path': 'cell.scene', 'Scene.joined.other': known['Scene'],
        'Scene.cutout.name': 'lid', 'Scene.turned.name': 'lid', 'notes': (),
        'Scene.read.friction': 0.2, 'hulls': False,
        'Capsule.start': (1.0, 0.0, 0.0), 'Cylinder.start': (1.0, 0.0, 0.0), 'cutout': hole,
        # simulators
        'at': 0.4, 'hold_at': 0.4, 'DirectSimulator.part.direction': 1, 'gripper': LEVEL,
        'grippers': [LEVEL, LEVEL], 'dt': 0.01, 'shape': shape,
        's': 0.5, 'Plan.at_arc_length.s': 0.9,
        'Section.surface_strain.strains': np.ones((4, 3)),
        'Rod.masses_per_length.s': [0.1, 0.2], 'Rod.natural_strains.s': [0.1, 0.2],
        'Rod.radii.s': [0.1, 0.2], 'Rod.stiffnesses.s': [0.1, 0.2], 'nodes': (),
        'Rod.mean_natural_strains.s': [0.0, 1.0], 'Rod.mean_stiffnesses.s': [0.0, 1.0],
        'Rod.node_masses.s': [0.0, 1.0], 'mass': 0.1, 'inertia': None, 'with_plug.center': None,
        'function': np.cos, 'breaks': (0.5,), 'PointLoad.force': (0.0, 0.0, 1.0),
        'moment': (0.0, 0.0, 1.0), 'point_loads': (),
        'Shape.s': shape.s, 'converged': True, 'n_elements': 8, 'n_terms': 4, 'path': 'saved',
        'Workspace.first_beyond.path': known['Trajectory'].path,
        'Shape.load.path': 'saved.npz', 'Plan.load.path': 'plan.npz',
        'Motion.load.path': 'motion.npz', 'Trajectory.load.path': 'trajectory.npz',
        **{f'{name}.load.path': f'{name}.json' for name in ('Fit', 'Robustness', 'Shapes')},
        'InverseSimulator.approach.standoff': 0.05,  # to find one takes seconds
        'InverseSimulator.approach.start': Pose.looking_along((-1.2, 0, 1), (1, 0, 0)),
        'displacement': (0.1, 0.0, 0.0), 'simulator': simulator, 'initial': None,
        'Observation.s': None, 'CutOut.radius': None, 'Sheet.cutouts': (),
        'Sheet.around.width': 1.0, 'Sheet.around.height': 1.0,
        # contacts and motions
        'obstacle': 0, 'force': 1.0, 'friction': (0.0, 0.0, 0.0), 'penetration': 0.0,
        'replay.friction': None, 'DirectSimulator.with_friction.friction': 0.2,
        'Plane.friction': 0.0, 'Sphere.friction': 0.0, 'Capsule.friction': 0.0,
        'Cylinder.friction': 0.0, 'Insert.friction': 0.2, 'InverseSimulator.insert.friction': 0.2,
        'Box.friction': 0.0, 'Ellipsoid.friction': 0.0, 'Sheet.friction': 0.0,
        'Mesh.friction': 0.0, 'Mesh.read.friction': 0.0, 'Mesh.mended.friction': 0.0,
        'Hull.friction': 0.0,
        'Sheet.around.friction': 0.0,
        'times': np.zeros(1), 'shapes': [shape], 'velocities': np.zeros((1, 9, 3)),
        'kinetic_energy': np.zeros(1), 'potential_energy': np.zeros(1), 'work': np.zeros(1),
        'losses': np.zeros((1, 3)), 'velocity': None, 'far_ends': None, 'tolerance': 1e-3,
        'replay.tolerance': None, 'robustness.fittings': (), 'robustness.seen': None,
        'robustness.hand_stiffness': None,
        'Motion.status': 'complete', 'integrator': 'paper',
        # tasks
        'bore': hole, 'cutouts': [hole], 'socket': LEVEL, 'plug': known['Plug'],
        'InsertPlug.depths': (0.0, 0.01), 'InsertPlug.from_depths.depths': (0.0, 0.01),
        'approach': 0.1, 'depth': 0.01, 'Plug.length': 0.05,
        'grasp': LEVEL, 'on_dlo': np.zeros(6),
        'fittings': [known['Clip']], 'mouth': (0.0, 0.0, 1.0), 'push': 0.1, 'retains': 1.0,
        'bears': 1.0, 'slip': 0.1, 'Fitting.room': 1e-3, 'Clip.room': 1e-3, 'Fork.room': 1e-3,
        'Peg.room': 1e-3,
        'Hold.slip': 0.0, 'Peg.friction': 0.2, 'Peg.angle': 1.0, 'tension': 1.0, 'standoff': 0.05,
        'slack': 0.01, 'tail': 0.1, 'Clip.grip': 'aligned', 'Fork.grip': 'ring',
        'Plug.wrench.gravity': (0.0, 0.0, -9.81),
        'second': FAR, **_of_tasks(known), **message_specimens.arguments(),
        'plan': known['Plan'], 'concatenate.one': known['Plan'],
        'concatenate.other': _back(known['Plan']), 'depths': DEPTHS,
        'contact': Pose((0.5, 0, 0.9), (0, 0, 0, 1)),
        'mode': 'straight',
        'lengths': [0.5], 'forces': [1.0], 'deadline': 1e9, 'penalties': known['PositionAt'],
        'target': (0.4, 0.0, 1.0), 'obstacles': (known['Sphere'],), 'distance': 0.1,
        'curvature': 1.0, 'sensitivity': Sensitivity(shape), 'max_iterations': 5,
        'DirectSimulator.obstacles': (), 'GraspedInside.obstacles': (), 'fit_rod.obstacles': (),
        'before': None, 'misalignment': np.zeros(1), 'Plan.position_error': np.zeros(1),
        'via_points': [()], 'Plan.clearance': np.zeros(1),
        'clearances': np.zeros((1, 0, 3)), 'sheets': (), 'fraction': 1.0,
        'status': PlanStatus.COMPLETE, 'Plan.depths': np.zeros(1), 'Plan.grippers': [LEVEL],
        'bend_margin': 1.0, 'contact_force': 0.0, 'clearance': 0.1,
        'ValidationReport.position_error': 0.0, 'ValidationReport.misalignment': 0.0,
        'uncertainty': known['Uncertainty'], 'causes': ('length',),
        'by_cause': np.zeros((1, 1)), 'first_order': np.zeros(1), 'sampled': np.zeros((0, 1)),
        'success': 1.0, 'part': 0.5, 'penalty': 0.0, 'slope': 0.0, 'points': np.ones((2, 3)),
        'motions': (), 'knots': None, 'correlations': None, 'ObservedMotion.s': [1.0],
        'ObservedMotion.times': [0.0, 0.01], 'ObservedMotion.points': np.ones((2, 1, 3)),
        'ObservedMotion.displacements': np.ones((1, 2, 1, 3)),
        'observations': [known['Observation']], 'values': {}, 'deviations': {}, 'misfit': 0.0,
        'keep_out': (), 'Uncertainty.length': 0.01, 'limits': None, 'samples': 0,
        # many at once
        'parallel.map.work': [LEVEL, LEVEL], 'executor': None, 'chunk': 2,
        'rods': [wire, wire],
        'tasks': 2,
        'Shapes.of.shapes': [shape],
        'Shapes.of.s': [0.0, 0.5, 1.0], 'Shapes.joined.parts': [known['Shapes']], 'parts': None,
        'Shapes.grippers': [LEVEL], 'parallel.Shapes.grippers': [LEVEL],
        **{f'{kind}.{name}': getattr(known['Shapes'], name)
           for kind in ('Shapes', 'parallel.Shapes') for name in (
            's', 'positions', 'frames', 'element_strains', 'gripper_wrench', 'energy',
            'elastic_energy', 'dissipated', 'residual', 'stability', 'violation', 'iterations',
            'converged', 'jumped', 'contact_table', 'self_contact_table')},
        'grid': capability().grid, 'inverse': known['InverseSimulator'], 'starts': (),
        'parallel.capability_map.folder': None, 'folder': 'map', 'patience': 2.0, 'axis': 'y',
        'quantity': 'share',
        'parallel.capability_map.depths': DEPTHS, 'directions': [[1, 0, 0]], 'radii': [0.2],
        'parallel.CellGrid.positions': [[0.4, 0, 1]], 'capability': capability(),
        **{f'parallel.CapabilityMap.{name}': getattr(capability(), name) for name in (
            'outcome', 'amount', 'fraction', 'clearance', 'stability', 'roll', 'start', 'gripper',
            'seconds')},
        'grasps': (0.0, 0.1), 'parallel.which_grasp.far_ends': None,
        'parallel.which_grasp.start': None, 'parallel.which_grasp.folder': None,
        'parallel.GraspMap.far_ends': (None,), 'found': grasp_map(), 'Fit.found': (),
        **{f'parallel.GraspMap.{name}': getattr(grasp_map(), name) for name in (
            'outcome', 'amount', 'fraction', 'margin', 'clearance', 'stability', 'force',
            'moment', 'seconds')},
        'name': 'wire', 'hardware_id': 'wire', 'level': b'\x00', 'message': 'ok',
        'diagnostics.diagnostics_msg.values': {'a': 1.0}, 'frame_id': 'world',
        'known': {}, 'color': 'yield', 'drawn': (),
        'index': 0, 'group': 'dlo', 'number_shown': 2,
        'trajectories.poses_ahead.times': [0.0, 1.0],
        'trajectories.poses_ahead.poses': [LEVEL, LEVEL],
        'trajectories.plan_path.times': [0.0, 1.0], 'seconds': 1.0,
        'trajectory': known['Trajectory'],
        'joint_trajectory': JointTrajectory(('joint',), [0.0, 1.0], *np.zeros((3, 2, 1))),
        'number': 3, 'tool': LEVEL, 'n': 2, 'modes_along.shapes': [shape, shape],
        'Modes.s': [0.0, 1.0], 'masses': [0.0, 1.0], 'frequencies': [1.0],
        'damping_ratios': [0.0], 'displacements': np.ones((1, 2, 3)),
        'participation': np.ones((1, 6)), 'overlap': [1.0], 'Trajectory.at.times': [0.0],
        'Trajectory.progress.times': [0.0],
        # estimates
        'uncertain': known['Estimate'].uncertain, 'mean': known['Estimate'].mean,
        'covariance': known['Estimate'].covariance, 'looks': 0, 'estimate': known['Estimate'],
        'observation': known['Observation'], 'elapsed': 0.0, 'stated': (0.4, 0.0, 1.0),
        'seen': (0.4, 0.0, 1.0), 'Estimate.miss.seen': None, 'Estimate.robot_change.seen': LEVEL,
        'waypoints': None, 'room': 0.01, 'first': 0,
        'off': np.zeros((1, 3)), 'bound': np.zeros(1), 'PredictedMiss.waypoints': [0],
        'PredictedMiss.joint': np.zeros((3, 3)), 'offsets': np.zeros((1, 6)),
        'InverseSimulator.thread_two.first': hole, 'Correction.miss': known['PredictedMiss'],
        'Correction.grippers': [LEVEL], 'stamps': [0.0, 1.0], 'time': 0.0,
        'gripper_at.stamp': 0.5, 'ClosedLoop.advanced.bound': 0.001, 'Observer.noise': 1e-3,
        'Observer.reopened.position': 2e-3, 'Observer.reopened.rotation': 0.02,
        'centers': [[0.4, 0.0, 1.0]],
        'Observer.reopened.kink': 0.02, 'Observer.reopened.camera': 2.0,
        'Observer.reopened.cutout': 1e-3, 'camera_rotation': 1e-3, 'Observer.stamps': 0.05,
        'Observer.update.velocity': [0.0, 0.0, 0.0, 0.1, 0.0, 0.0],
        'Observer.cutout': 1e-3, 'bias': 1e-3, 'outliers': 0.1, 'sway': 1e-3,
        'windows': [1.0, 0.5, 0.1], 'changes': (), 'correction': known['Correction'],
        # pictures and films
        'ax': None, 'Plan.animate.seconds': 0.1,
        'Motion.animate.seconds': 0.1, 'Plan.plot.color': 'time',
        'Motion.plot.color': 'time', 'Plan.animate.path': 'film.gif',
        'Motion.animate.path': 'film.gif', 'ValidationReport.load.path': 'report.npz',
        'reached': [0.0] * len(known['Correction'].grippers), 'plan_times': [0.0],
        'CorrectedTrajectory.at.times': [0.0], 'Observer.update.noise': 1e-3,
    }


def _of_tasks(known):
    back = Pose((-1.2, 0, 1), (0, 0, 0, 1))
    over_bar = known['InverseSimulator.hold_contact'].simulator
    free, touching = (PlanContext(one, one, start, touching=start is LEVEL)
                      for one, start in ((known['DirectSimulator'], back), (over_bar, LEVEL)))
    names = [name for name in PUBLIC if isinstance(known.get(name), Task)]
    return {
        'KeepTangent.begin': 0.0, 'KeepTangent.end': 0.5, 'ThreadTwo.first': known['CutOut'],
        'Approach.first': known['Shape'], 'context': free,
        'MoveTo.poses': [LEVEL], 'LayOnLine.line': LEVEL, 'LayOnLine.positions': [0.0],
        'HoldContact.solve.context': touching,
        'SlideContact.solve.context': touching,
        'task': known['Thread'], 'requirements': None, 'allow_plastic': True,
        'Requirements.limits': Limits(), 'workspace': None,
        **{f'{name}.from_dict.content': known[name].to_dict() for name in names}}


@cache
def capability():
    """Return a CapabilityMap, which is no public type by itself."""
    return capability_map(values()['InverseSimulator'],
                          CellGrid([[0.4, 0, 1]], [[1, 0, 0]], [0.2]), depths=DEPTHS)


@cache
def grasp_map():
    """Return a GraspMap, which is no public type by itself."""
    return which_grasp(values()['InverseSimulator'], values()['Thread'], (0.0, 0.1))


def _back(plan):
    """Return a Plan that goes back on the way of another."""
    turned = {name: getattr(plan, name)[::-1] for name in (
        'depths', 'grippers', 'shapes', 'misalignment', 'position_error', 'via_points',
        'clearances')}
    return replace(plan, **turned)
