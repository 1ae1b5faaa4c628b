# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Properties are tested with the same examples in every run, however busy the machine is.

Not in conftest.py: where Hypothesis is imported before rclpy, Python aborts at its end.
"""

from hypothesis import HealthCheck, given, settings, strategies

settings.register_profile('steady', derandomize=True, deadline=None,
                          suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('steady')

__all__ = ['given', 'settings', 'strategies']
