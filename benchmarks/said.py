# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers in sentences of a page: found again, and replaced by those that were measured last."""

import re
from collections.abc import Callable, Mapping


def places(said: str) -> str:
    """Return a pattern that goes on over the ends of lines."""
    return said.replace(' ', r'\s+')


def renewed(text: str, said: Mapping[str, Callable[[], list[str]]], name: str) -> str:
    """Return the text of the page `name` with the numbers that were measured last.

    Args:
        said: patterns with a group for each number, and what returns these numbers

    Raises:
        ValueError: one of the sentences is not there
    """
    for sentence, measured in said.items():
        found = re.search(places(sentence), text)
        if not found:
            raise ValueError(f'{name}: expected a sentence like {sentence!r}')
        whole, numbers = found[0], measured()
        for k in reversed(range(len(numbers))):
            begin, end = (place - found.start() for place in found.span(k + 1))
            whole = whole[:begin] + numbers[k] + whole[end:]
        text = text[:found.start()] + whole + text[found.end():]
    return text
