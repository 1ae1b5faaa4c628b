# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All figures of the paper as pictures and tables, each by a short script on the public names.

python -m benchmarks.figures [-o FOLDER] [fig01 fig02 ...]
"""

from importlib import import_module
from pathlib import Path

_HERE = Path(__file__).parent
MEASURED = ('fig05', 'fig06', 'fig08', 'fig09', 'fig10')  # those of the page of benchmarks


def scripts():
    """Return the scripts' modules by the names of their figures, in order."""
    return {path.stem.split('_')[0]: path.stem for path in sorted(_HERE.glob('fig*.py'))}


def main(folder, names=MEASURED):
    """Make pictures and tables of these figures."""
    known = scripts()
    for name in names:
        import_module(f'benchmarks.figures.{known[name]}').main(folder)
