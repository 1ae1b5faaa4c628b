# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The pose of the gripper at the time of an image."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.boundary_motion import poses
from dlo_planner.direct.continuation import between
from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import number, row, shown
from dlo_planner.model.pose import Pose


def gripper_at(stamps: ArrayLike, grippers: Iterable[Pose], stamp: float) -> Pose:
    """Return the gripper's Pose at the stamp of an image, between stamped poses.

    Between two poses the position is linear in time, and the rotation turns evenly about one axis.

    Parameters
    ----------
    stamps : array_like, shape (n,)
        Stamps in s, ascending, of the poses; on the clock of the image.
    grippers : iterable of Pose
        The n poses.
    stamp : float
        Stamp in s, of the image: when it was taken, not when it arrived.

    Raises
    ------
    InvalidTask
        An argument makes no sense, or the stamp is outside those of the poses.
    """
    stamps, grippers = row('stamps', stamps), poses(grippers, 1)
    stamp = number('stamp', stamp)
    if (np.diff(stamps) <= 0).any():
        raise InvalidTask(f'stamps = {shown(stamps.tolist())}: expected times that grow')
    if stamps.size != len(grippers):
        raise InvalidTask(f'grippers has {len(grippers)} entries: expected one per stamp, '
                          f'{stamps.size}')
    if not stamps[0] <= stamp <= stamps[-1]:
        raise InvalidTask(f'stamp = {stamp:.9g}: expected one between those of the poses, '
                          f'{stamps[0]:.9g} to {stamps[-1]:.9g} s')
    after = min(int(np.searchsorted(stamps, stamp, side='right')), stamps.size - 1)
    if after == 0:
        return grippers[0]
    share = (stamp - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
    result: Pose = between(grippers[after - 1], grippers[after], float(share))
    return result
