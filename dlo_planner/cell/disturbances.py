# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What happens to the cell during a run, which neither the planner nor the robot knows."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import direction, instance, items, number, vector
from dlo_planner.model.value import Value, put

_SLIPS = 0.05            # s, in which a DLO slips
_SINES = 8               # of which a wandering consists
_WAVES = 16              # of which an error that depends on the pose consists
_REACH = 0.4             # m of the gripper's way in which that changes: half the reach of a robot
_LEVER = 0.25            # m, by which a turn counts as a way
_SLOWEST, _FASTEST = 0.05, 0.3  # Hz, of these
_AHEAD = 0.5             # periods of a vibration after a push, in which its peak is looked for
_PUSH = 241              # times at which it is looked for
_APART = 1e-9            # of a square: a critically damped oscillator would be 0 / 0


@dataclass(frozen=True, eq=False, repr=False)
class Slip(Value):
    """The DLO slips in the grip, smoothly within 50 ms, and stays there."""

    time: float  # time at which it begins, s
    back: float = 0.0  # by how much the DLO moves back, against the x axis of the gripper, m
    # (3,) rotation vector by which it turns, axes of the gripper, rad
    turn: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        put(self, time=number('Slip.time', self.time, minimum=0),
            back=number('Slip.back', self.back), turn=vector('Slip.turn', self.turn, 3))
        super().__post_init__()

    def share(self, time: float) -> float:
        """Return which part of it has happened at a time in s, 0 to 1."""
        return _begun(time - self.time)


@dataclass(frozen=True, eq=False, repr=False)
class Kink(Value):
    """The DLO is bent for good at one place, smoothly within 50 ms, as a bump leaves a wire."""

    time: float  # time at which it begins, s
    angle: float = 0.02  # by which it is bent without stress afterwards, rad
    place: float = 0.3  # part of the length; it is bent in the nearest joint
    about: float = 0.0  # angle of the axis of the bend from the n axis of the section, rad

    def __post_init__(self) -> None:
        put(self, time=number('Kink.time', self.time, minimum=0),
            angle=number('Kink.angle', self.angle), about=number('Kink.about', self.about),
            place=number('Kink.place', self.place, minimum=0, maximum=1))
        super().__post_init__()

    def bend(self, time: float) -> Floats:
        """Return the angles (2,) about n and b at a time in s, rad."""
        return _begun(time - self.time) * self.angle * np.array(
            [np.cos(self.about), np.sin(self.about)])


def _begun(elapsed: float) -> float:
    """Return which part of a sudden change has happened after some s, 0 to 1."""
    x = min(max(elapsed / _SLIPS, 0.0), 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


@dataclass(frozen=True, eq=False, repr=False)
class Bump(Value):
    """Something pushes the DLO for a while, by a force that rises and falls as sin^2.

    So large that the place which is pushed would move by `displacement` at most if nothing else
    happened, by small vibrations about the shape at the beginning.
    """

    time: float  # time at which it begins, s
    displacement: float = 0.01  # displacement in m, the largest
    # (3,) direction of the force, world axes; of any length; only its part across the DLO counts
    direction: Floats = (0.0, 1.0, 0.0)  # type: ignore[assignment]
    place: float = 1.0  # place that is pushed, as a part of the length
    duration: float = 0.4  # duration of the force, s

    def __post_init__(self) -> None:
        put(self, time=number('Bump.time', self.time, minimum=0),
            displacement=number('Bump.displacement', self.displacement, minimum=0),
            direction=direction('Bump.direction', self.direction),
            place=number('Bump.place', self.place, above=0, maximum=1),
            duration=number('Bump.duration', self.duration, above=0))
        super().__post_init__()

    def profile(self, time: float) -> float:
        """Return the force at a time in s over its largest."""
        x = (time - self.time) / self.duration
        return float(np.sin(np.pi * x) ** 2) if 0 < x < 1 else 0.0

    def response(self, frequencies: Floats, lag: float) -> Floats:
        """Return how oscillators (n,) of unit mass answer its `profile`, while and after."""
        times = np.linspace(0, self.duration + _AHEAD * 2 * np.pi / frequencies[0], _PUSH)
        begun = _switched_on(frequencies, lag, self.duration, times)
        # sin^2 that goes on, less the same from its end on
        return begun - _switched_on(frequencies, lag, self.duration, times - self.duration)


def _switched_on(frequencies: Floats, lag: float, period: float, times: Floats) -> Floats:
    """Return the answer (n, k) to sin^2 of a period from time 0 on: a steady and a free part."""
    squares, times = frequencies[:, None] ** 2, np.maximum(times, 0)
    push, half = 2 * np.pi / period, 0.5 * lag * squares
    swing = 1 / (squares - push**2 + 2j * half * push) * np.ones_like(times)
    steady = 0.5 * (1 / squares - (swing * np.exp(1j * push * times)).real)
    begins = 0.5 * (1 / squares - swing.real), -0.5 * (1j * push * swing).real
    root = np.sqrt(half**2 - squares * (1 + _APART) + 0j)
    free: Floats = 0.0 * steady
    for one, other in ((root - half, -root - half), (-root - half, root - half)):
        size = (other * begins[0] - begins[1]) / (one - other)
        free += (size * np.exp(one * times)).real
    answer: Floats = steady + free
    return answer


@dataclass(frozen=True, eq=False, repr=False)
class Disturbances(Value):
    """What happens to the cell during a run; by default nothing."""

    # standard deviation of the robot's error, m along each axis of the gripper: from the measured
    # to the true place. It is a smooth function of the pose, as that of a robot whose links and
    # joints are not quite known, and repeats itself
    robot_position: float = 0.0
    robot_rotation: float = 0.0  # the same of its rotation, rad about each axis
    # roots of the mean squares of a further error that wanders in time, m and rad: a sum of sines
    # of 0.05 to 0.3 Hz
    wander_position: float = 0.0
    wander_rotation: float = 0.0
    # lag of each of the two first-order stages by which the robot follows commands, s
    lag: float = 0.0
    friction: float = 0.0  # friction of the sheet; the planner does without
    slips: tuple[Slip, ...] = ()
    bumps: tuple[Bump, ...] = ()
    kinks: tuple[Kink, ...] = ()
    # (3,) m, world axes, by which all sheets with their holes are elsewhere than the Truth says
    sheets_shift: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        put(self, **{name: number(f'Disturbances.{name}', getattr(self, name), minimum=0)
                     for name in ('robot_position', 'robot_rotation', 'wander_position',
                                  'wander_rotation', 'lag', 'friction')})
        put(self, slips=items('Disturbances.slips', self.slips, Slip),
            bumps=items('Disturbances.bumps', self.bumps, Bump),
            kinks=items('Disturbances.kinks', self.kinks, Kink),
            sheets_shift=vector('Disturbances.sheets_shift', self.sheets_shift, 3))
        super().__post_init__()

    @property
    def times(self) -> tuple[float, ...]:
        """When something happens, s."""
        return (*(slip.time for slip in self.slips), *(bump.time for bump in self.bumps),
                *(kink.time for kink in self.kinks))

    def draw(self, rng: np.random.Generator) -> 'Course':
        """Return how the robot errs in one run."""
        instance('rng', rng, np.random.Generator)
        return Course(self, rng.uniform(_SLOWEST, _FASTEST, (6, _SINES)),
                      rng.uniform(0, 2 * np.pi, (6, _SINES)),
                      rng.standard_normal((6, _WAVES, 9)) / _REACH,
                      rng.uniform(0, 2 * np.pi, (6, _WAVES)))


@dataclass(frozen=True, eq=False, repr=False)
class Course(Value):
    """The Disturbances of one run; `Disturbances.draw` makes one."""

    disturbances: Disturbances
    # (6, k) frequencies in Hz and phases in rad, of the sines in which the robot wanders: its place
    # along, its rotation about the axes of the gripper
    frequencies: Floats
    phases: Floats
    # (6, k, 9), (6, k) the error by the pose: wave vectors, 1/m, over place and the first two axes
    # of the gripper, these times 0.25 m; and phases, rad. By the random features of a Gaussian
    # process (Rahimi and Recht 2007)
    waves: Floats
    begins: Floats
    # time from which those of slips and bumps count, s; inf: nothing happens yet
    since: float = 0.0

    @property
    def times(self) -> tuple[float, ...]:
        """When something happens in this run, s."""
        return tuple(self.since + time for time in self.disturbances.times)

    def push(self, bump: Bump, time: float) -> float:
        """Return the force of one of its bumps at a time in s over its largest."""
        return bump.profile(time - self.since)

    def bend(self, kink: Kink, time: float) -> Floats:
        """Return the angles (2,) about n and b of one of its kinks at a time in s, rad."""
        return kink.bend(time - self.since)

    def robot_error(self, place: Floats, rotation: Floats, time: float) -> tuple[Floats, Floats]:
        """Return a robot's shift (3,) in m and rotation vector (3,) in rad at a pose and time."""
        of = self.disturbances
        at = np.concatenate([place, _LEVER * rotation[:, 0], _LEVER * rotation[:, 1]])
        error = np.zeros(6)
        for sizes, angles in (
                ((of.robot_position, of.robot_rotation), self.waves @ at + self.begins),
                ((of.wander_position, of.wander_rotation),
                 2 * np.pi * self.frequencies * time + self.phases)):
            error += np.repeat(sizes, 3) * np.sqrt(2 / angles.shape[1]) * np.sin(angles).sum(axis=1)
        return error[:3], error[3:]

    def in_grip(self, time: float) -> tuple[float, Floats]:
        """Return by how much the DLO has moved back, m, and turned (3,), rad, in the grip."""
        slips = self.disturbances.slips
        shares = [slip.share(time - self.since) for slip in slips]
        return (sum(share * slip.back for share, slip in zip(shares, slips, strict=True)),
                sum((share * slip.turn for share, slip in zip(shares, slips, strict=True)),
                    np.zeros(3)))

    def held(self, place: Floats, rotation: Floats, time: float) -> tuple[Floats, Floats]:
        """Return place (3,) and rotation (3, 3) of the beginning of the DLO."""
        shift, turn = self.robot_error(place, rotation, time)
        back, about = self.in_grip(time)
        place = place + rotation @ shift
        rotation = rotation @ Rotation.from_rotvec(turn).as_matrix()
        return (place - back * rotation[:, 0],
                rotation @ Rotation.from_rotvec(about).as_matrix())


UNDISTURBED = Disturbances()
