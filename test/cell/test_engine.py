# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Without the physics engine there is no cell, and it says why."""

import importlib
import sys

import pytest


def test_what_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    monkeypatch.delitem(sys.modules, 'dlo_planner.cell.chain', raising=False)
    with pytest.raises(ImportError, match=r'pip install dlo_planner\[cell\]'):
        importlib.import_module('dlo_planner.cell.chain')
