# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A picture of a capability map: slices of the region that can be reached; needs matplotlib."""

from typing import TYPE_CHECKING

import numpy as np

from dlo_planner.extras import extra
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance
from dlo_planner.parallel.capability import CapabilityMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 12      # slices
_ALIKE = 1e-6   # m: positions in one slice
QUANTITIES = {'share': 'part of directions and radii that can be threaded',
              'clearance': 'largest clearance [m]', 'stability': 'largest stability',
              'radius': 'narrowest radius that can be threaded [m]'}


def slices(capability: CapabilityMap, axis: str = 'y', quantity: str = 'share') -> 'Figure':
    """Return a matplotlib Figure: the positions in slices across an axis, colored by a quantity.

    Crosses stand where no cut-out can be threaded, dots where none has been looked at. Of more
    than 12 slices 12 are shown.

    Parameters
    ----------
    capability : CapabilityMap
    axis : str, optional
        'x', 'y' or 'z' of the world, across which the slices lie.
    quantity : str, optional
        'share' of all directions and radii; or the best of them in 'clearance', 'stability' or
        'radius'.

    Raises
    ------
    InvalidTask
        An argument makes no sense.
    MissingExtra
        Matplotlib is not installed.
    """
    instance('capability', capability, CapabilityMap)
    across = 'xyz'.index(choice('axis', axis, ('x', 'y', 'z')))
    choice('quantity', quantity, tuple(QUANTITIES))
    first, second = (k for k in range(3) if k != across)
    places = capability.grid.positions
    levels = np.unique(np.round(places[:, across] / _ALIKE)) * _ALIKE
    levels = levels[np.unique(np.linspace(0, levels.size - 1, min(levels.size, _MOST)).astype(int))]
    values, known = best(capability, quantity), (capability.outcome != '').any(axis=(1, 2))
    low, high = 0.0, 1.0
    if quantity != 'share' and np.isfinite(values).any():
        low, high = np.nanmin(values), np.nanmax(values)
    columns = min(levels.size, 4)
    figure = extra('matplotlib.figure', 'figures', 'pictures').Figure(
        figsize=(1.5 + 3.2 * columns, 1.5 + 3.0 * -(-levels.size // columns)),
                    layout='constrained')
    axes = figure.subplots(-(-levels.size // columns), columns, squeeze=False, sharex=True,
                           sharey=True).ravel()
    for axis_, level in zip(axes, levels, strict=False):
        in_slice = np.abs(places[:, across] - level) <= _ALIKE
        some = in_slice & np.isfinite(values)
        drawn = axis_.scatter(*places[some][:, [first, second]].T, c=values[some], s=60, vmin=low,
                              vmax=max(high, low + 1e-12), cmap='viridis', marker='s')
        empty, unknown = in_slice & known & ~some, in_slice & ~known
        axis_.plot(*places[empty][:, [first, second]].T, 'x', color='tab:red', ms=5)
        axis_.plot(*places[unknown][:, [first, second]].T, '.', color='0.7', ms=3)
        axis_.set(title=f'{axis} = {level:.3g} m', aspect='equal', xlabel=f'{"xyz"[first]} [m]',
                  ylabel=f'{"xyz"[second]} [m]')
        axis_.grid(alpha=0.3)
    for axis_ in axes[levels.size:]:
        axis_.set_visible(False)
    figure.colorbar(drawn, ax=list(axes[:levels.size]), label=QUANTITIES[quantity])
    figure.suptitle(repr(capability), fontsize=10)
    return figure


def best(capability: CapabilityMap, quantity: str) -> Floats:
    """Return (P,) the quantity of `slices` at each position; nan where nothing can be threaded."""
    threaded = capability.threaded
    some = threaded.any(axis=(1, 2))
    if quantity == 'share':
        return np.where(some, threaded.mean(axis=(1, 2)), np.nan)
    if quantity == 'radius':
        return np.where(some, capability.least_radius.min(axis=1), np.nan)
    values = np.where(threaded, getattr(capability, quantity), -np.inf).max(axis=(1, 2))
    return np.where(some, values, np.nan)
