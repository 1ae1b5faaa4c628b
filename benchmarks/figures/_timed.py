# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Times of the paper's two minimizers and of Newton's method on benchmark C."""

from benchmarks.cases import ANGLES, turned, wire
from benchmarks.timing import duration
from dlo_planner import DirectSimulator

METHODS = {'newton': 'Newton', 'dfp': 'DFP', 'downhill_simplex': 'downhill simplex'}
_LONGEST = 30.0  # s: a method that took longer is not asked for more
_SHORT = 2.0     # s: what takes less is timed three times, the median counts


def times(method, sizes):
    """Return {(N_L, N_c): s of all 37 poses}, as far as they converge and it does not take long."""
    found, poses, shapes = {}, [turned(angle) for angle in ANGLES], []
    for elements, terms in sizes:
        simulator = DirectSimulator(wire(), n_elements=elements, n_terms=terms, method=method)
        simulator.solve(poses[0])  # compiled

        def run(simulator=simulator):
            shapes[:] = simulator.track(poses)

        spent = [duration(run)]
        if spent[0] < _SHORT:
            spent += [duration(run), duration(run)]
        if all(shape.converged for shape in shapes):
            found[elements, terms] = sorted(spent)[len(spent) // 2]
        if spent[0] > _LONGEST:
            break
    return found
