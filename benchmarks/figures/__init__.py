# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's Fig. 5, 6, 8, 9, 10, 12 as tables and pictures, by public names only."""

from importlib import import_module

SCRIPTS = ('series_terms', 'elements', 'time_by_elements', 'time_by_terms', 'speedup', 'dependent')


def main(folder):
    """Make all tables and pictures."""
    for name in SCRIPTS:
        import_module(f'benchmarks.figures.{name}').main(folder)
