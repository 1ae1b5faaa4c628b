# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Timings of the package beside a hand-written loop and beside its peers; the paper's figures.

`python -m benchmarks --help`
"""
