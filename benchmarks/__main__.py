# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Timings beside the floor, peers, suite and figures; tables and pictures are written to a folder.

python -m benchmarks [all | core | check | counts | peers | suite | figures] [--output FOLDER]
"""

import argparse
import sys
from pathlib import Path
from time import perf_counter

from benchmarks import counts, guards, page, report, reproduction
from benchmarks.table import rows

_DOCS = Path(__file__).parent.parent / 'docs' / 'benchmarks'
_AGAIN = 3  # times that a row which seems too slow is measured again


def core(folder, budget, words):
    """Time all rows whose names contain `words`; print, write, and return row -> ratio."""
    found = {}
    for row in rows():
        if words not in row.name:
            continue
        timed = row.time(budget)
        found[row.name] = row, timed
        cells = report.line(row, timed)
        print(f'{cells[0]:58s}' + ''.join(f'{cell:>11s}' for cell in cells[1:5])
              + f'  {cells[5]:34s} {cells[6]}', flush=True)
    text = report.markdown(report.HEADS, [report.line(*pair) for pair in found.values()])
    if not words:
        report.write(folder, 'core', '# Timings of the core', text, report.as_json(found))
    return {name: timed.ratios['floor'] for name, (row, timed) in found.items()
            if row.guarded and 'floor' in timed.ratios}


def check(budget, words):
    """Measure guarded rows, those that seem too slow several times; return what stays so."""
    kept = guards.load()
    guarded = {row.name: row for row in rows() if row.guarded and words in row.name}
    now = {name: row.time(budget).ratios['floor'] for name, row in guarded.items()}
    for _ in range(_AGAIN):
        for excess in guards.excesses(kept, now):
            now[excess.name] = min(now[excess.name],
                                   guarded[excess.name].time(budget).ratios['floor'])
    for name, ratio in now.items():
        print(f'{name:58s} {ratio:8.2f} times the floor, kept {kept.get(name, float("nan")):.2f}')
    return guards.excesses(kept, now)


def counted(words, keep):
    """Count what the rows do whose names contain `words`; return 1 if anything has grown."""
    kept = counts.load()
    now = {row.name: counts.of_row(row) for row in rows() if counts.is_counted(row, words)}
    grown = 0
    for name, one in now.items():
        more = counts.differences(kept.get(name, one), one)
        grown += bool(more)
        print(f'{name:70s}' + ''.join(f'{count:>9d}' for count in one) + f'  {", ".join(more)}')
    if keep:
        counts.store({**kept, **now} if words else now)
    return int(grown > 0 and not keep)


def main(arguments=None):
    """Run what was asked for; return the exit status."""
    parser = argparse.ArgumentParser(prog='benchmarks', description=__doc__.splitlines()[0])
    parser.add_argument('what', nargs='?', default='all',
                        choices=('all', 'core', 'check', 'counts', 'peers', 'suite', 'figures'))
    parser.add_argument('--output', type=Path, default=_DOCS)
    parser.add_argument('--budget', type=float, default=2.0, help='s for a row')
    parser.add_argument('--rows', default='', help='only rows whose names contain this')
    parser.add_argument('--store', action='store_true',
                        help='keep the ratios for `check`, the counts for `counts`')
    given = parser.parse_args(arguments)
    started = perf_counter()
    if given.what == 'check':
        found = check(given.budget, given.rows)
        print('\n'.join(map(str, found)) or 'no ratio has grown by 30 %')
        return 1 if found else 0
    if given.what == 'counts':
        return counted(given.rows, given.store)
    if given.what in ('all', 'core'):
        ratios = core(given.output, given.budget, given.rows)
        if given.store:
            guards.store({**guards.load(), **ratios})
    for name in ('peers', 'suite', 'figures'):
        if given.what in ('all', name):
            _part(name)(given.output)
    if not given.rows:
        page.write(given.output)
        if given.output == _DOCS:
            reproduction.write()
    print(f'{perf_counter() - started:.0f} s; written to {given.output}')
    return 0


def _part(name):
    """Return the function of a part; it is imported only if it is wanted."""
    if name == 'peers':
        from benchmarks.peers.compare import main as part  # noqa: PLC0415  extras
    elif name == 'suite':
        from benchmarks.suite import main as part  # noqa: PLC0415  extras
    else:
        from benchmarks.figures import main as part  # noqa: PLC0415  matplotlib
    return part


if __name__ == '__main__':
    sys.exit(main())
