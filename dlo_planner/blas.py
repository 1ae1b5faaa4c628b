# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threads of BLAS in processes of this package: one."""

import os

_NAMES = ('OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'BLIS_NUM_THREADS')


def one_thread_of_blas() -> None:
    """Give BLAS one thread in this process and its children; what is set already is left.

    Matrices have at most some hundred rows here. More threads gain nothing on an idle machine; on a
    busy one they wait for each other, and an eigenproblem of 3 ms takes 30 to 300 ms. To be called
    before NumPy is imported, and by processes of this package only: a program that uses the library
    decides by itself.
    """
    for name in _NAMES:
        os.environ.setdefault(name, '1')
