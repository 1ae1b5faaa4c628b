# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Properties are tested with the same examples in every run, however busy the machine is.

The soak looks at others each time: it sets HYPOTHESIS_PROFILE=exploring, and a seed.

Not in conftest.py: where Hypothesis is imported before rclpy, Python aborts at its end.
"""

import os

from hypothesis import HealthCheck, given, settings, strategies

for name, same in (('steady', True), ('exploring', False)):
    settings.register_profile(name, derandomize=same, deadline=None, database=None,
                              suppress_health_check=[HealthCheck.too_slow])
settings.load_profile(os.environ.get('HYPOTHESIS_PROFILE', 'steady'))

__all__ = ['given', 'settings', 'strategies']
