# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One file for each script whose numbers the documentation states; `ENTRY` is its Validation."""
