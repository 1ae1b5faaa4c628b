# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What answers are compared with: equations of rods by SciPy, and closed forms."""
