# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tasks in the cell (`dlo_planner.cell`): drivers, runs, a table of what came of them."""
