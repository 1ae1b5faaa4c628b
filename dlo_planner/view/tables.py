# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the page says beside its picture, as HTML; every text from outside is escaped."""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from dlo_planner.plan.plan import Plan
from dlo_planner.view.colors import viridis
from dlo_planner.view.summaries import plan_columns

_STEPS = 9
_MARGINS = ('miss [', 'miss in', 'clearance', 'margin', 'stability', 'force', 'duration', 'swing')
_TINY = 1e-6  # what is smaller is rounding
_SHOWN = {'m': ('mm', 1e3), '': ('-', 1.0)}  # unit -> that of the page, and how many make one
LEVELS = {0: ('ok', '#1b7837'), 1: ('warning', '#b35806'), 2: ('error', '#b2182b'),
          3: ('stale', '#666666')}


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of texts; all but the first column are aligned to the right."""
    def line(cells: Sequence[str], tag: str) -> str:
        return '<tr>' + ''.join(
            f'<{tag} style="padding:1px 6px;text-align:{"right" if k else "left"};'
            f'font-weight:{600 if tag == "th" else 400}">{escape(str(cell))}</{tag}>'
            for k, cell in enumerate(cells)) + '</tr>'

    body = line(head, 'th') + ''.join(line(row, 'td') for row in rows)
    return ('<table style="font-size:12px;line-height:1.35;border-collapse:collapse;'
            f'width:calc(100% - 12px);margin:2px 6px">{body}</table>')


def margins(plan: Plan, index: int) -> str:
    """Return the table of a Plan's margins: at one waypoint, and the worst of all."""
    rows = []
    for name, values, worst, unit in plan_columns(plan):
        shown, scale = _SHOWN.get(unit, (unit, 1.0))
        rows.append((f'{name} [{shown}]', _figure(scale * values[index]), _figure(scale * worst)))
    return table((f'waypoint {index + 1} of {len(plan)}', 'here', 'worst'), rows)


def values_table(values: Mapping[str, str], first: str) -> str:
    """Return the table of named values, the names headed `first`."""
    return table((first, ''), list(values.items()))


def margin_values(values: Mapping[str, str]) -> dict[str, str]:
    """Return what diagnostics of the planner say of margins, as the page says it."""
    return {name: _spoken(text) for name, text in values.items()
            if any(word in name for word in _MARGINS)}


def message(text: str, level: int | None = None) -> str:
    """Return a line of text in the color of its level: 0 ok, 1 warning, 2 error, 3 stale; None."""
    word, color = LEVELS.get(3 if level is None else level, ('', LEVELS[3][1]))
    word = f'<b>{word}:</b> ' if word else ''
    return (f'<div style="font-size:13px;line-height:1.35;padding:2px 12px;color:{color}">'
            f'{word}{escape(text)}</div>')


def color_bar(caption: str) -> str:
    """Return the colors from low to high, with what they mean under them."""
    stops = ', '.join('rgb({:.0f},{:.0f},{:.0f})'.format(*(255 * color))
                      for color in viridis(np.linspace(0, 1, _STEPS)))
    return ('<div style="padding:4px 12px;font-size:12px">'
            f'<div style="height:12px;background:linear-gradient(to right,{stops})"></div>'
            f'{escape(caption)}</div>')


def _spoken(text: str) -> str:
    try:
        value = float(text)
    except ValueError:
        return text
    return 'not looked at' if np.isnan(value) else _figure(value)


def _figure(value: float) -> str:
    if 0 < abs(value) < _TINY:
        return f'< {_TINY:.0e}'
    return 'no limit' if np.isposinf(value) else f'{value:.3g}'
