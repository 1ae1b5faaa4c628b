# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What acts on a DLO: the list of effects, and the kernels that ask all of them.

An effect is one file of this folder and one line in EFFECTS. The file has a Record of what it
acts by, and those of these functions that it needs (kernels but for the last two):

    add_forces(effect, system, state)       its forces; returns its potential in J, and how large
                                            the terms are of which that is a sum
    add_stiffness(effect, system, state, diagonal)  second derivatives by the elements' strains
    noise(effect, system, state, length)    forces whose relative rounding errors its own have, N
    blocks(effect, system, before, after)   whether it forbids the way from a State to another
    may_block(effect)                       whether it ever does
    acts(effect, system, strains, positions, before)  whether it would have a say in a step of a DLO
                                            that was found without it, see `direct.culling`
    fill_rows(effect, rotation, position, out)      what it holds of the far end (`minimize.border`)
    fill_miss(effect, rotation, position, miss)     and by how much that is missed
    stored(effect, system, strains)         energy that it stores in the DLO, J
    potential(effect, system, positions)    its potential where the nodes are in the world, J
    needs(effect)                           dict: what the solver has to provide for it, see `Needs`
    hinged(effect, part)                    the same with one more element before the first, which
                                            has a `part` of that one's stiffness (`direct.hinge`)

Forces go to `state.slope` (by strains), `state.pull` (nodes) and `state.attached` (elsewhere);
their second derivatives by the nodes' places to `state.weight` and `state.attached`.

Where there is no such effect it is None. numba compiles nothing of what stands behind
`if effect is None: return`, so each kernel that gets an effect begins with it, but for the first
and the last of the list, which are always there.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from dlo_planner.energy import contact, elastic, hold, inertia, loads, magnet, plastic
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.attached import Attached, nothing_attached
from dlo_planner.ritz.record import Record, makes

EFFECTS = {'elastic': elastic, 'plastic': plastic, 'load': loads, 'anchor': inertia,
           'hold': hold, 'contact': contact, 'magnet': magnet}


class Effects(Record):
    """What acts on a DLO: of each effect its Record, or None."""

    __annotations__ = dict.fromkeys(EFFECTS, Record)


class Border(Record):
    """What K rows that are held add to a Newton system, see `minimize.border`.

    Attributes
    ----------
    rows : ndarray, shape (K, m, 3)
        Derivatives of what is held by the unknowns.
    answers : ndarray, shape (K, m, 3)
        H^-1 of them.
    schur : ndarray, shape (K, K)
        Inverse of rows answers + give.
    give : ndarray, shape (1,)
        By how much each of them gives way, m/N.
    """

    rows: Floats
    answers: Floats
    schur: Floats
    give: Floats


class Needs(Record):
    """What effects need of the solver; None where no effect that is there ever does.

    Attributes
    ----------
    displaced : bool or None
        Whether displacements of what lies beyond an element matter, not only rotations.
    attached : Attached or None
        An empty one of the right sizes, where forces act elsewhere than on nodes.
    border : Border or None
        An empty one of the right number of rows, where something is held.
    """

    displaced: bool | None
    attached: Attached | None
    border: Border | None


@makes(Needs)
@kernel
def _new_needs(displaced, attached, border):
    return Needs(displaced, attached, border)


@makes(Border)
@kernel
def _new_border(rows, answers, schur, give):
    return Border(rows, answers, schur, give)


def needs_of(effects: Effects, nodes: int) -> Needs:
    """Return the Needs of Effects on a DLO with so many nodes."""
    asked = [module.needs(effect) for name, module in EFFECTS.items()
             if hasattr(module, 'needs') and (effect := getattr(effects, name)) is not None]
    if not asked:
        return _nothing_needed()
    displaced = any(one.get('displaced', False) for one in asked)
    attached = border = None
    if any('attached' in one for one in asked):
        element = np.concatenate([one.get('element', _NOWHERE) for one in asked])
        attached = nothing_attached(nodes if any(one.get('sprung') for one in asked) else 0,
                                    element, any(one.get('beside', False) for one in asked))
    if any('rows' in one for one in asked):
        held = sum(one.get('rows', 0) for one in asked)
        border = Border(np.empty((held, 0, 3)), np.empty((held, 0, 3)), np.empty((0, 0)),
                        np.zeros(1))
    return Needs(displaced, attached, border)


@cache
def _nothing_needed() -> Needs:
    return Needs(None, None, None)


_NOWHERE = np.zeros(0, dtype=np.int64)


@kernel
def new_border(border, unknowns):
    """Return an empty Border of as many rows as `border`, for (m, 3) unknowns; None for None."""
    out = border
    if border is not None:
        held = border.rows.shape[0]
        out = Border(np.empty((held, unknowns, 3)), np.empty((held, unknowns, 3)),
                     np.empty((held, held)), np.zeros(1))
    return out


@kernel
def row_count(border):
    """Return how many rows are held."""
    if border is None:
        return 0
    return border.rows.shape[0]


@kernel
def width(displaced):
    """Return how many numbers tell how what lies beyond an element moves: 6, or 3 of rotation."""
    if displaced is None:
        return 3
    return 6 if displaced else 3


def _written(name: str, arguments: str, body: list[str], **scope: Any) -> Callable[..., Any]:
    """Return the kernel of a text; numba wants every field and call to be written out."""
    scope |= {'__name__': __name__, 'Effects': Effects}
    exec('\n    '.join([f'def {name}({arguments}):', *body]), scope)
    return kernel(scope[name])


def _of_all(hook: str, arguments: str, begin: str, each: str, end: str) -> Callable[..., Any]:
    """Return the kernel that calls a hook of all effects that have it.

    Parameters
    ----------
    hook : str
        Name of the hook.
    arguments : str
        Arguments of the hook, after the effect.
    begin, end : str
        First and last line.
    each : str
        Line for an effect, {} where the call stands.
    """
    calls = {f'{name}_{hook}': (getattr(module, hook), name) for name, module in EFFECTS.items()
             if hasattr(module, hook)}
    lines = [each.format(f'{call}(effects.{name}{arguments})')
             for call, (_, name) in calls.items()]
    return _written(hook, f'effects{arguments}', [begin, *lines, end],
                    **{call: function for call, (function, _) in calls.items()})


add_forces = _of_all('add_forces', ', system, state', 'energy, size = 0.0, 0.0',
                     'more, terms = {}; energy += more; size += terms', 'return energy, size')
add_stiffness = _of_all('add_stiffness', ', system, state, diagonal', '', '{}', 'return')
noise = _of_all('noise', ', system, state, length', 'forces = 0.0', 'forces += {}',
                'return forces')
blocks = _of_all('blocks', ', system, before, after', 'found = False', 'found = found or {}',
                 'return found')
may_block = _of_all('may_block', '', 'found = False', 'found = found or {}', 'return found')
acts = _of_all('acts', ', system, strains, positions, before', 'found = False',
               'found = found or {}', 'return found')
fill_rows = _of_all('fill_rows', ', rotation, position, out', '', '{}', 'return')
fill_miss = _of_all('fill_miss', ', rotation, position, miss', '', '{}', 'return')
stored = _of_all('stored', ', system, strains', 'energy = 0.0', 'energy += {}', 'return energy')
potential = _of_all('potential', ', system, positions', 'energy = 0.0', 'energy += {}',
                    'return energy')


def _replacing(name: str) -> Callable[..., Any]:
    """Return the kernel (effects, effect) -> the same Effects but for the one of that name."""
    values = ', '.join('effect' if one == name else f'effects.{one}' for one in EFFECTS)
    return _written(f'with_{name}', 'effects, effect', [f'return Effects({values})'])


with_anchor, with_hold, with_contact = (_replacing(name) for name in ('anchor', 'hold', 'contact'))
makes(Effects)(_written('_new_effects', ', '.join(EFFECTS),
                        [f'return Effects({", ".join(EFFECTS)})']))
