# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From observations: properties of a DLO, a running estimate, a corrected plan."""
