# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The inverse tasks: one frozen value for each."""

from dlo_planner.inverse.tasks.approach import Approach
from dlo_planner.inverse.tasks.contact import HoldContact, SlideContact
from dlo_planner.inverse.tasks.insert import Insert
from dlo_planner.inverse.tasks.minimize import Minimize
from dlo_planner.inverse.tasks.move_to import MoveTo
from dlo_planner.inverse.tasks.thread import Thread
from dlo_planner.inverse.tasks.thread_sequence import ThreadSequence, cutouts_of, threading_of
from dlo_planner.inverse.tasks.thread_two import ThreadTwo

__all__ = ['Approach', 'HoldContact', 'Insert', 'Minimize', 'MoveTo', 'SlideContact',
           'Thread', 'ThreadSequence', 'ThreadTwo', 'cutouts_of', 'threading_of']
