# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Some 3,700 frozen answers, which a refactoring of the core is held against; public names only.

`answers.py` says what is frozen of an answer and how near another one has to be. The cases come
from stated seeds (`given.py`): `shapes.py`, `contacts.py`, `motions.py`, `plans.py`, `refusals.py`,
listed in `kinds.py`. `frozen.py` is the file that `freezing.py` writes and `checking.py` compares.
"""

from warnings import simplefilter

from dlo_planner import DoubtfulInput

simplefilter('ignore', DoubtfulInput)  # DLOs that are drawn at random are of any material
