# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Load and faults: odd messages of every kind, latencies, what happens to machines and clocks."""
