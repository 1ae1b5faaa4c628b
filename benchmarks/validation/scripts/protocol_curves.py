# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Master curves of the protocols."""

from benchmarks.validation.entry import Measure, Validation, largest

ENTRY = Validation(
    name='master curves of the protocols',
    shows='level cantilever over five decades, lateral buckling of a strip',
    extra='matplotlib',
    against='shooting and linearized Kirchhoff equations (SciPy)',
    script='test/protocol_curves.py',
    arguments=('{output}/protocols.png',),
    measures=(Measure('width, height, default accuracy',
                      largest('default: width off by {}, height by {} L'), 1e-3, 'L'),
              Measure('aspect, default accuracy', largest('default: width .* aspect by {}'), 1e-3),
              Measure('aspect, accuracy=1e-5', largest('accuracy 1e-5: .* aspect by {}'), 1e-3),
              Measure('lateral buckling, from SciPy', largest("buckling, .* off by {} of SciPy's"),
                      1e-3),
              Measure('lateral buckling, from its closed form', largest('SciPy.s, {} of'), 1e-3)),
)
