# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The house: imports go one way down, kernels are compiled once."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def test_imports_go_down_the_layers():
    linter = pytest.importorskip('importlinter.cli', reason='import-linter is not installed')
    assert linter.lint_imports(config_filename=str(ROOT / 'pyproject.toml'), no_cache=True) == 0


def test_core_does_not_import_ros():
    code = 'import dlo_planner, sys; sys.exit(any(m.startswith("rclpy") for m in sys.modules))'
    assert subprocess.run([sys.executable, '-c', code], cwd=ROOT, check=False).returncode == 0
