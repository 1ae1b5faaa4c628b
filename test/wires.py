# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Wires that several tests hold."""

from dlo_planner import Rod


def copper_wire(**more):
    """Return the paper's: 1 m of copper, 1 mm thick; `more` are further arguments of the Rod."""
    return Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, **more)
