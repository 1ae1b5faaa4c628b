# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a motion has no more energy than there can be.

Its books (5,) are, in J: the least balance so far (energy that is there, less what was put in, plus
what was taken out), the least and the most potential energy, the most kinetic energy, and the last
balance.
"""

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

_PER_STEP = 0.5  # of the energy that a motion may still gain


@kernel
def entered(books: Floats, energies: Floats, part: float, noise: float) -> bool:
    """Whether an instant has no more energy than there can be; if so, `books` (5,) has it.

    A step may use up half of what the motion may still gain: were it all, no later one could go on,
    however short it is.

    Args:
        books: renewed
        energies: of the instant, as of a Trail, J
        part, noise: of the energy that has moved which may be gained, and J in addition
    """
    static, kinetic, work, lost = energies[1], energies[2], energies[3], energies[5]
    balance = kinetic + static - work + lost
    left = allowed(books, energies, part, noise) - (books[4] - books[0])
    if not balance - books[4] <= max(_PER_STEP * left, 0.0):
        return False
    books[0], books[4] = min(books[0], balance), balance
    books[1], books[2] = min(books[1], static), max(books[2], static)
    books[3] = max(books[3], kinetic)
    return True


@kernel
def allowed(books: Floats, energies: Floats, part: float, noise: float) -> float:
    """Return the energy, J, that a motion may gain until an instant; arguments as `entered`."""
    low, high = min(books[1], energies[1]), max(books[2], energies[1])
    most: float = part * (max(books[3], energies[2]) + high - low + energies[5]) + noise
    return most


def given_back(books: Floats, balance: float, began: float) -> None:
    """Enter that the rates of an instant are renewed: what that adds is no gain of a step.

    As far as steps before have lost it. So a motion never has more than there was and was done.

    Parameters
    ----------
    books : ndarray, shape (5,)
        Changed.
    balance, began : float
        Balance with these rates, and where the motion began, J.
    """
    lost = max(began - books[4], 0.0)
    books[0] = min(books[0] + min(max(balance - books[4], 0.0), lost), balance)
    books[4] = balance
