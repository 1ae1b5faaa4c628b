# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The solver that cosseratbench calls."""

from importlib.metadata import PackageNotFoundError, version

import numpy as np
from cosseratbench.scenario import End, EndCondition, Scenario
from cosseratbench.scenario import Rod as RodOfScenario
from cosseratbench.solver import Capability
from cosseratbench.trajectory import Trajectory

from benchmarks.cosserat.cord import Cord, recorded, settled
from benchmarks.cosserat.swinging import swung
from benchmarks.cosserat.touching import pressed

_GRIPS = {EndCondition.CLAMPED: 'clamped', EndCondition.PINNED: 'pinned', EndCondition.FREE: None}


class DloPlanner:
    """Kirchhoff rods at rest by Newton's method, and in motion by implicit steps.

    Of a quasi-static scenario the equilibrium is computed, not the way there: all frames but the
    first one show it.
    """

    name = 'dlo_planner'
    capabilities = frozenset({Capability.STRETCH, Capability.ROD_CONTACT})

    @property
    def backend_version(self) -> str:
        """The version of this package."""
        try:
            return version('dlo_planner')
        except PackageNotFoundError:
            return 'from source'

    def settings(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> dict[str, object]:
        """Return what was chosen for a scenario."""
        if scenario.quasi_static:
            return {'method': 'Newton on arcs of constant strain; stretch and contact by turns',
                    'frames': 'the equilibrium, but for the first one'}
        return {'integrator': 'generalized alpha (implicit, second order)',
                'time_step': scenario.duration / (n_frames - 1), 'stretch': 'as at rest'}

    def run(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> Trajectory:
        """Return the Trajectory of a scenario.

        Raises
        ------
        NotImplementedError
            Something in it has no counterpart here; the message names it.
        FloatingPointError
            No equilibrium was found, or a motion could not go on.
        """
        refuse(scenario)
        cords = [cord_of(rod, scenario, n_elements) for rod in scenario.rods]
        times = np.linspace(0, scenario.duration, n_frames)
        if scenario.quasi_static:
            found = pressed((cords[0], cords[1])) if len(cords) > 1 else [settled(cords[0])]
            ends = [recorded(cord, *rest) for cord, rest in zip(cords, found, strict=True)]
            frames = [tuple(np.stack([first] + [last] * (n_frames - 1)) for first, last in
                            zip((cord.nodes, cord.directors), end, strict=True))
                      for cord, end in zip(cords, ends, strict=True)]
        else:
            frames = [swung(cord, times) for cord in cords]
        positions, directors = zip(*frames, strict=True)
        return Trajectory(times, positions, directors)


def refuse(scenario: Scenario) -> None:
    """Raise NotImplementedError where a scenario has what this package does not know."""
    motions = [rod.motion(end) for rod in scenario.rods for end in End]
    pairs = len(scenario.rods) > 1
    for what, is_there in (
            ('fixed obstacles beside rods', scenario.obstacles),
            ('rods that touch themselves', scenario.self_contact),
            ('more than two rods', len(scenario.rods) > 2),
            ('friction between rods', pairs and any(rod.friction for rod in scenario.rods)),
            ('rods that touch while they move', pairs and not scenario.quasi_static),
            ('ends that are moved', any(motion is not None for motion in motions))):
        if is_there:
            raise NotImplementedError(f'{what}: not modeled')


def cord_of(rod: RodOfScenario, scenario: Scenario, n: int) -> Cord:
    """Return the Cord of a scenario's rod with n elements."""
    if rod.start is EndCondition.FREE:
        raise NotImplementedError('a rod whose start is free: not modeled')
    pull = np.zeros(3)
    for load in rod.loads:
        if load.at is End.END:
            pull += load.force
    material, grip = rod.material, _GRIPS[rod.start]
    assert grip is not None  # it is not free
    return Cord(rod.length, rod.radius, material.density, material.youngs_modulus,
                material.shear_modulus, rod.nodes(n), rod.directors(n), grip,
                _GRIPS[rod.end], pull, np.array(scenario.gravity, dtype=float))
