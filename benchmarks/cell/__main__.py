# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.cell`."""

import sys

from benchmarks.cell.bench import main

sys.exit(main())
