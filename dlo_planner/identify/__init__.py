# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From observations: properties of a DLO, an estimate on the way, a plan aimed anew."""
