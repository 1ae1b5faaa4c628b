# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Other ways to the same shapes: how long they take to be right within 1 mm, 0.1 mm, 1 um."""
