# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the package is checked against, measured again: tables and JSON of docs/validation.md.

A row is either asserted by tests (`asserted/*.toml`) or printed by a script (`scripts.py`).
"""
