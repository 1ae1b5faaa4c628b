# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A test that is run again begins anew, with fixtures of its module and its session, too.

What failed may have ended the process that a module's tests share; pytest-rerunfailures keeps it,
and sets aside how it is taken down.
"""

import pytest


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Take down all that the run before has left."""
    if getattr(item, 'execution_count', 1) > 1:
        from pytest_rerunfailures import (  # noqa: PLC0415, it is here, as it runs this again
            suspended_finalizers,
        )
        item.session._setupstate.stack.update(suspended_finalizers)
        suspended_finalizers.clear()
        item.session._setupstate.teardown_exact(None)
