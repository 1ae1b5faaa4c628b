# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All peers side by side, in CPU time; one is printed only for what is right enough."""

from time import process_time

import numpy as np

from benchmarks import report
from benchmarks.peers import boundary, chain, descent, elastica, ours
from benchmarks.peers.reference import CASES, Reference

PEERS = (ours, boundary, descent, chain, elastica)
GOALS = (1e-3, 1e-4, 1e-6)  # m
_ENOUGH = 30.0  # s: what takes longer is not tried any finer
_LONG = 5.0     # s: what takes more is not run a second time
_QUICK = 0.5    # s: what takes less is timed again, the median counts


def error_of(shapes, reference) -> float:
    """Return the largest distance in m from the reference of all nodes in all poses."""
    return max(float(np.linalg.norm(found - reference(k, s), axis=1).max())
               for k, (s, found) in enumerate(shapes))


def attempts(peer, case, reference):
    """Return [(s of time, m of error or None)] for each rung of a peer's ladder."""
    found = []
    for rung in peer.LADDER:
        run, times = peer.prepare(case, rung), []
        while sum(times) < _QUICK and len(times) < 20 or len(times) == 1 and times[0] < _LONG:
            started = process_time()
            shapes = run()
            times.append(process_time() - started)
        times = times[1:] or times  # the first one may compile
        error = None if shapes is None else error_of(shapes, reference)
        found.append((float(np.median(times)), error))
        if times[0] > _ENOUGH:
            break
    return found


def time_to(goal: float, found) -> float | None:
    """Return the shortest time of an attempt that is right within `goal` (m), None if none is."""
    times = [time for time, error in found if error is not None and error <= goal]
    return min(times, default=None)


def line(name, case, found):
    """Return the cells of a row."""
    errors = [error for _, error in found if error is not None]
    cells = [_text(time_to(goal, found)) for goal in GOALS]
    best = f'{min(errors):.1e} m' if errors else 'none converged'
    return [case, name, *cells, best]


def _text(time):
    return '-' if time is None else f'{1e3 * time:.3g} ms'


def main(folder):
    """Compare, print, and write the table."""
    lines, data = [], {}
    for case in CASES:
        reference = Reference(case)
        for peer in PEERS:
            if not peer.LADDER:
                continue  # is not installed
            found = attempts(peer, case, reference)
            if all(error is None for _, error in found):
                cells = [case.name, peer.NAME, '-', '-', '-', 'none converged, or not tried']
            else:
                cells = line(peer.NAME, case.name, found)
            lines.append(cells)
            data.setdefault(case.name, {})[peer.NAME] = [
                {'rung': rung, 's': time, 'error_m': error}
                for rung, (time, error) in zip(peer.LADDER, found, strict=False)]
            print(' | '.join(cells), flush=True)
    heads = ['case', 'by', *(f'time to {goal:g} m' for goal in GOALS), 'smallest error']
    report.write(folder, 'peers', '# Peers', report.markdown(heads, lines), data)
