# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plugin of pytest that keeps what assertions have measured, and their limits.

`assert error < 1e-6` passes or fails; here the error is kept too. The environment says which tests
count (DLO_VALIDATION_TESTS, a JSON list of what their names begin with) and where the records go
(DLO_VALIDATION_RECORDS, a folder).
"""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from benchmarks.validation.comparisons import comparison

_KEPT = 3  # of each test, those nearest to their limits


class Recorder:
    """What tests have measured: `records` by the tests' names."""

    def __init__(self, wanted: list[str], folder: Path):
        self._wanted, self._folder = tuple(wanted), folder
        self._now = ''
        self.records: dict[str, dict[str, Any]] = {}
        self._close = np.testing.assert_allclose

    def pytest_configure(self) -> None:
        """Listen to comparisons of arrays, too."""
        np.testing.assert_allclose = self._compare_arrays

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, config: pytest.Config,
                                      items: list[pytest.Item]) -> None:
        """Leave out what was not asked for, and what needs a machine for itself."""
        kept = [item for item in items if item.nodeid.startswith(self._wanted)
                and not item.get_closest_marker('real_time')]
        config.hook.pytest_deselected(items=[item for item in items if item not in set(kept)])
        items[:] = kept

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Begin the record of a test."""
        self._now = nodeid
        self.records[nodeid] = {'outcome': 'passed', 'checks': 0, 'nearest': [], 'seconds': 0.0}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep how a test ended."""
        record = self.records.setdefault(report.nodeid, {'checks': 0, 'nearest': []})
        record['seconds'] = record.get('seconds', 0.0) + report.duration
        if report.outcome != 'passed':
            record['outcome'] = report.outcome

    def pytest_assertion_pass(self, orig: str, expl: str) -> None:
        """Keep a comparison of numbers."""
        self._keep(comparison(orig, expl))

    def pytest_sessionfinish(self) -> None:
        """Write the records."""
        np.testing.assert_allclose = self._close
        worker = os.environ.get('PYTEST_XDIST_WORKER', 'main')
        (self._folder / f'{worker}.json').write_text(json.dumps(self.records))

    def _compare_arrays(self, actual: ArrayLike, desired: ArrayLike, rtol: float = 1e-7,
                        atol: float = 0, **more: Any) -> None:  # noqa: ANN401  numpy's own
        self._close(actual, desired, rtol=rtol, atol=atol, **more)
        off = np.abs(np.asarray(actual, float) - np.asarray(desired, float))
        allowed = atol + rtol * np.abs(np.asarray(desired, float))
        off, allowed = (np.ravel(part) for part in np.broadcast_arrays(off, allowed))
        good = allowed > 0
        if good.any():
            worst = np.argmax(off[good] / allowed[good])
            self._keep(('difference of arrays', float(off[good][worst]),
                        float(allowed[good][worst])))
        else:
            self._keep(None)

    def _keep(self, found: tuple[str, float, float] | None) -> None:
        if self._now not in self.records:
            return
        record = self.records[self._now]
        record['checks'] += 1
        if found is not None:
            source, measured, limit = found
            record['nearest'].append((measured / limit, source, measured, limit))
            record['nearest'] = sorted(record['nearest'], reverse=True)[:_KEPT]


def pytest_configure(config: pytest.Config) -> None:
    """Register the recorder where the environment asks for it."""
    if 'DLO_VALIDATION_TESTS' in os.environ and not config.pluginmanager.has_plugin('recorder'):
        recorder = Recorder(json.loads(os.environ['DLO_VALIDATION_TESTS']),
                            Path(os.environ['DLO_VALIDATION_RECORDS']))
        config.pluginmanager.register(recorder, 'recorder')
