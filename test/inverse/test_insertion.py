"""Insertion into a bore: along the deflection curve, nothing to bear at the mouth."""

import numpy as np
import pytest

from dlo_planner import (
    CutOut,
    DirectSimulator,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    replay,
)

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
RODS = {'round': WIRE,
        'bent': Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.6, 0.4), natural_twist=0.3),
        'weighted': Rod(1.0, 0.05, (0.3, 0.6), 0.25, tip_mass=0.05, point_masses=((0.7, 0.02),))}
BORE = CutOut(Pose.looking_along((0.1, 0, 1), (1, 0.2, 0)))
DEPTHS = np.linspace(0, 0.95, 8)


@pytest.mark.parametrize('name', ['round', 'bent'])
def test_a_uniform_dlo_follows_its_first_shape(name):
    direct = DirectSimulator(RODS[name], accuracy=1e-7)
    inverse = InverseSimulator(direct)
    plan = inverse.insert(BORE, depths=DEPTHS)
    curve = direct.solve(plan.grippers[0], inverse.thread(BORE, depths=[0.0]).shapes[0])
    for depth, gripper in zip(DEPTHS, plan.grippers, strict=True):
        on = curve.at(depth)
        assert np.linalg.norm(on.position - gripper.position) < 1e-6
        np.testing.assert_allclose(on.rotation, gripper.rotation, atol=1e-5)
    threading = inverse.thread(BORE, depths=DEPTHS)  # begins alike, and goes another way
    np.testing.assert_allclose(threading.grippers[0].matrix, plan.grippers[0].matrix, atol=1e-6)
    apart = [np.linalg.norm(a.position - b.position)
             for a, b in zip(threading.grippers, plan.grippers, strict=True)]
    assert max(apart) > 0.05


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('name', RODS)
def test_the_mouth_bears_nothing(name, basis):
    rod = RODS[name]
    direct = DirectSimulator(rod, basis=basis)
    plan = InverseSimulator(direct).insert(BORE, depths=DEPTHS)
    assert plan.fraction == 1 and plan.stability.min() > 0
    assert set(DEPTHS) <= set(plan.depths)
    for depth, gripper, shape in zip(plan.depths, plan.grippers, plan.shapes, strict=True):
        if np.abs(shape.far_wrench).max() > 1e-6:
            continue  # the mouth takes over a mass: another test
        # a DLO cut off at the mouth, with nothing to hold it there
        masses = [(s, m) for s, m in rod.point_masses if s <= 1 - depth]
        cut = Rod(1 - depth, rod.mass_per_length, rod.bending_stiffness, rod.torsional_stiffness,
                  rod.natural_curvature, rod.natural_twist, masses,
                  0.0 if depth else rod.tip_mass)
        end = DirectSimulator(cut, basis=basis).solve(gripper, shape).at(1 - depth)
        assert np.linalg.norm(end.position - BORE.centre) < 1e-7
        assert np.linalg.norm(np.cross(end.direction, BORE.normal)) < 1e-6
    bears = np.array([np.abs(shape.far_wrench).max() for shape in plan.shapes])
    assert (bears > 1e-6).any() == (name == 'weighted')
    asked = np.isin(plan.depths, DEPTHS) & (plan.depths > 0)
    assert bears[asked].max() < 1e-6
    report = replay(direct, plan)
    assert report.converged and report.miss < 1e-6 and report.misalignment < 1e-6


def test_refused_and_named():
    soft = InverseSimulator(DirectSimulator(Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)))
    with pytest.raises(Infeasible) as caught:
        soft.insert(BORE)
    assert caught.value.waypoint == 0 and caught.value.constraint == 'stability'
    stiff = InverseSimulator(DirectSimulator(WIRE))
    with pytest.raises(InvalidTask, match='bore'):
        stiff.insert(3)
    with pytest.raises(InvalidTask, match=r'depths\[1\]'):
        stiff.insert(BORE, depths=[0, 1.0])
    with pytest.raises(InvalidTask, match='limits'):
        replay(DirectSimulator(WIRE), stiff.insert(BORE, depths=[0.2, 0.3]), limits=Limits())
