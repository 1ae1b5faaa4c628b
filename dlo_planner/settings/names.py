# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Names of parameters that do not exist, and what was probably meant."""

from collections.abc import Iterable
from difflib import get_close_matches


def unknown_parameter(name: str, known: Iterable[str]) -> str:
    """Return the warning about a value for a parameter that does not exist."""
    by_lower = {one.lower(): one for one in known}
    ends = {one.rsplit('.', 1)[-1]: one for one in by_lower}
    given = name.lower()
    near = get_close_matches(given, by_lower, 1) or [
        ends[end] for end in get_close_matches(given.rsplit('.', 1)[-1], ends, 1)]
    hint = f': did you mean {by_lower[near[0]]}?' if near else ''
    return f'parameter {name} does not exist, its value has no effect{hint}'
