# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The package as a solver of cosseratbench, found there through an entry point of this package."""
