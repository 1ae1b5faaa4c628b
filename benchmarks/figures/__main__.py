# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's figures, all or those that are named."""

import argparse
from pathlib import Path

from benchmarks.figures import main, scripts

if __name__ == '__main__':
    parser = argparse.ArgumentParser(prog='benchmarks.figures', description=__doc__)
    parser.add_argument('names', nargs='*', choices=[[], *scripts()], metavar='fig01 ...')
    parser.add_argument('-o', '--output', type=Path, default=Path('figures_output'))
    given = parser.parse_args()
    main(given.output, given.names or scripts())
