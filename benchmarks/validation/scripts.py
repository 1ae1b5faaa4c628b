# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The scripts whose numbers the documentation states, and what is read from them."""

from benchmarks.validation.entry import Measure, Validation, largest, others_than, smallest


def _beyond(text: str) -> float:
    """Return how many scenes are farther apart than both engines say."""
    return float(text.count('| **no** |'))  # of the table, not of the lines before it


SWEEPS = 'test/sweeps'
ENTRIES = [
    Validation(
        name='closed loop, direct simulator as the truth',
        shows='1.5 mm wire, stiffness 5 %, mass 2 %, length 1 mm, natural curvature 0.05 1/m and '
              'varying 0.03 1/m, gripper 0.5 mm and 0.2 degrees, 24 points of 1 mm noise, 10 % '
              'outliers, a third hidden: miss at the entry after looks at the start pose and at '
              'the standoff',
        against='the true DLO; chi-square of the predicted miss (2 expected)',
        script='test/closed_loops.py', arguments=('6',), whole=('40',),
        measures=(Measure('largest miss', largest(r'standoff +\S+ +\S+ +{} '), 1.0, 'mm'),
                  Measure('chi-square, at most', largest('chi-square {} of 2'), 4.0),
                  Measure('within the 95 % bound, at least', smallest('within the bound {}%'), 80,
                          '%', least=True))),
    Validation(
        name='another engine: MuJoCo',
        shows='free wires and strips, contact with bar, plane, sphere, holes, motions: see below',
        against="MuJoCo's chains, extrapolated from four to seven refinements",
        script='-m benchmarks.cross_check', arguments=('{output}',), extra='mujoco',
        measures=(Measure('scenes beyond their limits', _beyond, 0),
                  Measure("shown in contact, MuJoCo's own error included",
                          largest(r'^wire (?:on|in) (?:[^|]*\|){3} {} mm'), 1.0, 'mm'))),
    Validation(
        name='cables of other engines, predicted for 5 s',
        shows='predicted from the markers on both grippers alone, with 1 mm of noise on each; mean '
              'absolute error over coordinates, free markers and frames',
        against='a discrete rod and MuJoCo, recorded as the DEFORM data set is',
        script='-m benchmarks.deform_surrogate', arguments=('--known', '--cables', '1', '3'),
        whole=('--output', 'docs/benchmarks'), extra='mujoco',
        measures=(Measure('largest of both', largest(r'of free markers {} mm'), 5.0, 'mm'),
                  Measure('not predicted', largest(r'{} of \d+ not predicted'), 0))),
    Validation(
        name='honesty of `fit_rod`',
        shows='share of the errors within one and within 1.96 stated deviations (68 and 95 % '
              'expected; samples of 40 scatter by 5 and 3 points)',
        against='the rod that made the shapes, repeated experiments',
        script='test/fit_coverage.py', arguments=('40', 'with s', 'with s, gripper'),
        whole=('200',),
        measures=(Measure('within one, least', smallest(r'68 %: +{}'), 55, '%', least=True),
                  Measure('within one, most', largest(r'68 %: +{}'), 81, '%'),
                  Measure('within 1.96, least', smallest(r'95 %: +{}'), 88, '%', least=True))),
    Validation(
        name='motions in a plane, benchmark C among them',
        shows='swing, turn of 180 degrees in 1 s, tip mass, 20 Hz shake, benchmark C in 2 s '
              'without damping: true error of the tip until 1.5 s',
        against='chains of bars (SciPy, Runge-Kutta), known to 0.2 to 2.1 mm',
        script='test/references/planar_motions.py', arguments=(),
        measures=(Measure('largest true error of the four',
                          largest('^(?:swing|whirl|tip|shake).*true error {} mm'), 5.0, 'mm'),
                  Measure('of benchmark C', largest('^C to 1.5 s.*true error {} mm'), 1.0, 'mm'),
                  Measure('numerical loss', largest('numerical loss .* to {} % of'), 1.0, '%'))),
    Validation(
        name='master curves of the protocols',
        shows='level cantilever over five decades, lateral buckling of a strip',
        against='shooting and linearized Kirchhoff equations (SciPy)',
        script='test/references/protocol_curves.py', arguments=('{output}/protocols.png',),
        extra='matplotlib',
        measures=(Measure('width, height, default accuracy',
                          largest('default: width off by {}, height by {} L'), 1e-3, 'L'),
                  Measure('aspect, default accuracy', largest('default: width .* aspect by {}'),
                          1e-3),
                  Measure('aspect, accuracy=1e-5', largest('accuracy 1e-5: .* aspect by {}'), 1e-3),
                  Measure('lateral buckling, from SciPy',
                          largest("buckling, .* off by {} of SciPy's"), 1e-3),
                  Measure('lateral buckling, from its closed form', largest('SciPy.s, {} of'),
                          1e-3))),
    Validation(
        name='random ways of Panda, UR5, Kinova j2s6s200',
        shows='found again from the way of the tool, from the present joints and without; the tool '
              'within 1e-4 m and rad',
        against='the URDF multiplied out by hand',
        script=SWEEPS, arguments=('arms', '2'), whole=('arms', '20'), extra='pinocchio',
        measures=(Measure('not found', others_than('found'), 0),)),
    Validation(
        name='random contacts held',
        shows='spheres, bars, planes, boxes: held with the least energy, or refused and confirmed',
        against='Runge-Kutta over eight decades of the force; direct simulation',
        script=SWEEPS, arguments=('contacts', '20'), whole=('contacts', '100'),
        measures=(Measure('neither held nor confirmed', others_than('held', 'confirmed', 'away'),
                          0),)),
    Validation(
        name='random cut-outs',
        shows='rods round, flat, bent, twisted, w L^3/EI from 0.25 to 10: plans replay below 1e-6 '
              'm and rad, without a leap; refusals are confirmed',
        against='replay from the natural shape; all ways to hang',
        script=SWEEPS, arguments=('cutouts', '40'), whole=('cutouts', '300'),
        measures=(Measure('neither replayed nor confirmed', others_than('replayed', 'confirmed'),
                          0),)),
    Validation(
        name='random DLOs drawn over obstacles',
        shows='mu from 0.05 to 0.8: steps in contact that converge and keep the law of friction',
        against='mu N, within 1e-6 of it',
        script=SWEEPS, arguments=('drags', '30'), whole=('drags', '127'),
        measures=(Measure('steps in contact that do not converge',
                          others_than('converged', 'away'), 1),)),
    Validation(
        name='cables held at both ends',
        shows='w L^3/EI from 1 to 1e5, also with GJ = 1e-4 EI, free and over a peg: all converge '
              'at spans of 0.65 to 0.95 L; up to 0.999 L what converges is right, the rest is '
              'refused',
        against="SciPy's boundary value solver on the Kirchhoff equations, within ten times the "
                'error estimate (free, usual torsion)',
        script=SWEEPS, arguments=('held', '4'), whole=('held', '24'),
        measures=(Measure('neither right nor refused beyond 0.99 L',
                          others_than('right', 'converged', 'refused taut'), 0),
                  Measure('refused beyond 0.99 L, of 32', others_than('right', 'converged'), 10),
                  Measure('smallest estimate / error', smallest('estimate / error {} to'), 0.1,
                          least=True))),
    Validation(
        name='random bores',
        shows='inserted without a leap of the gripper, or refused at the first waypoint',
        against='rates of the gripper',
        script=SWEEPS, arguments=('insertions', '30', '1'), whole=('insertions', '100', '1'),
        measures=(Measure('neither inserted nor refused', others_than('inserted', 'refused'),
                          0),)),
    Validation(
        name='random pairs of cut-outs',
        shows='both centers hit within 1e-6 m, no leap; refusals are confirmed',
        against='replay; all ways to hang',
        script=SWEEPS, arguments=('pairs', '20'), whole=('pairs', '300'),
        measures=(Measure('neither replayed nor confirmed', others_than('replayed', 'confirmed'),
                          0),)),
    Validation(
        name='random rods',
        shows='w L^3/EI from 0.1 to 1e5, stiffness ratio up to 1000, up to three natural turns, '
              'any pose: a minimum, within ten times the error estimate; of seven '
              'discretizations, too, the estimate is not below a tenth of the error',
        against="SciPy's boundary value solver on the Kirchhoff equations; Jacobi's condition for "
                'a minimum by its integrator',
        script=SWEEPS, arguments=('rods', '150'), whole=('rods', '2000'),
        measures=(Measure('rods that are no minimum', others_than('a minimum', 'good'), 0),
                  Measure('smallest estimate / error', smallest('estimate / error {} to'), 0.1,
                          least=True))),
    Validation(
        name='random sequences of three cut-outs',
        shows='plans of 100 waypoints replay within 1e-6 m, no leap; refusals are confirmed',
        against='replay; all ways to hang',
        script=SWEEPS, arguments=('sequences', '3'), whole=('sequences', '16'),
        measures=(Measure('neither replayed nor confirmed', others_than('replayed', 'confirmed'),
                          0),)),
    Validation(
        name='real wires: the white one',
        shows='a loop between two clamps: EI of five photographs, one of them predicted from the '
              'others, the twist that tips it; see below',
        against='photographs and twists measured by others (arXiv 2310.00911)',
        script='-m benchmarks.real_wires', arguments=('--only', 'white', '--output', '{output}'),
        data='DLO_WIRES',
        measures=(Measure('EI of the five: chi-square per degree of freedom',
                          largest('as it is said, all: .* chi-square {} per'), 2.0),
                  Measure('points off the wire', largest('as it is said, all: .*, {} mm off'),
                          8.0, 'mm'),
                  Measure('with the angles of camera and clamps found',
                          largest('angles found, all: .*m.2, {} mm off'), 4.0, 'mm'),
                  Measure('photograph 5 from 1 to 4',
                          largest('as it is said, photograph 5 from the others: {} mm'), 7.0, 'mm'),
                  Measure("tips, with the authors' stiffnesses, off by",
                          largest("the authors' EI and GJ: .*, {} % off"), 20.0, '%'),
                  Measure('GJ / EI with which it tips where it was measured to',
                          largest(r'GJ = \({} '), 1.0),
                  Measure('after it tipped', largest('after it gives way: {} mm'), 8.0, 'mm'))),
    Validation(
        name='real wires: the black and the red one',
        shows='the same; what is no homogeneous section, and hangs otherwise each time: see below',
        against='photographs and twists measured by others (arXiv 2310.00911)',
        script='-m benchmarks.real_wires',
        arguments=('--only', 'black', 'red', '--output', '{output}'), data='DLO_WIRES',
        measures=(Measure('EI of the five: chi-square per degree of freedom',
                          largest('as it is said, all: .* chi-square {} per'), 2.0),
                  Measure('points off the wire', largest('as it is said, all: .*, {} mm off'),
                          25.0, 'mm'),
                  Measure('with the angles of camera and clamps found',
                          largest('angles found, all: .*m.2, {} mm off'), 10.0, 'mm'),
                  Measure('photograph 5 from 1 to 4',
                          largest('as it is said, photograph 5 from the others: {} mm'), 25.0,
                          'mm'),
                  Measure("tips, with the authors' stiffnesses, off by",
                          largest("the authors' EI and GJ: .*, {} % off"), 10.0, '%'))),
    Validation(
        name='rods whose properties jump',
        shows='mass, load, natural strains, stiffness: the accuracy asked for, an honest estimate',
        against='Runge-Kutta from jump to jump (SciPy)',
        script=SWEEPS, arguments=('jumps', '6'), whole=('jumps', '200'),
        measures=(Measure('answers that are not good', others_than('good'), 0),
                  Measure('smallest estimate / error', smallest('estimate / error {} to'), 0.1,
                          least=True))),
]
