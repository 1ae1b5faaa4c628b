# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motions in a plane."""

from benchmarks.validation.entry import Measure, Validation, largest

ENTRY = Validation(
    name='motions in a plane, benchmark C among them',
    shows='swing, turn of 180 degrees in 1 s, tip mass, 20 Hz shake, benchmark C in 2 s without '
          'damping: true error of the tip until 1.5 s',
    against='chains of bars (SciPy, Runge-Kutta), known to 0.2 to 2.1 mm',
    script='test/motion_cases.py',
    arguments=(),
    measures=(Measure('largest true error of the four',
                      largest('^(?:swing|whirl|tip|shake).*true error {} mm'), 5.0, 'mm'),
              Measure('of benchmark C', largest('^C to 1.5 s.*true error {} mm'), 1.0, 'mm'),
              Measure('numerical loss', largest('numerical loss .* to {} % of'), 1.0, '%')),
)
