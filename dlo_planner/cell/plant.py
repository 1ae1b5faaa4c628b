# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The plant: a DLO in a moving gripper, in a physics engine.

It stands for the real cell and shares only data types (`dlo_planner.model`) with the planner.

    plant = Plant(rod, poses[0], [Sheet.around(hole)], damping=0.005)    # hangs at rest
    for pose in poses[1:]:
        plant.move(pose, period)
    print(plant.passage(hole), plant.largest_forces)
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from dlo_planner.cell.chain import (
    DLO,
    SCENE,
    add_chain,
    add_far_grip,
    add_grip,
    add_gripper,
    chain_of,
    mujoco,
    place_in,
    set_rest,
    set_springs,
)
from dlo_planner.cell.disturbances import Bump, Course
from dlo_planner.cell.robot import nearer
from dlo_planner.cell.truth import Truth
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer, items, number, row, vector
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.holds import FarEnd, Hold
from dlo_planner.model.obstacles import OBSTACLES, Capsule, Hull, Mesh, Obstacle, Plane, Sheet
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.triangles import hull, volume
from dlo_planner.model.value import Value

STEP = 2e-3      # s, of time in runs of the cell
TOUCH = 0.05     # N: a larger contact force counts as a touch
_GRAVITY = (0.0, 0.0, -9.81)
_STILL = 1e-8     # rad per `Chain.slowness`: a DLO that moves no faster is at rest
_SETTLING = 0.02  # of `Chain.slowness`: step of time while it settles
_STILL_HELD = 1e-5  # the same of one whose far end is held
_LED = 400        # steps in which that is led there
_DRAG = 0.05      # part of all velocities that is taken away in each step while it settles
_LONGEST = 20_000  # steps until it is at rest
# solref, solimp of the engine: as stiff as a step of time allows, penetration well below 0.1 mm
_STIFF_CONTACT = (2e-4, 1.0), (0.95, 0.99, 1e-4, 0.5, 2.0)
# solref of hands, s and damping ratio: two of them that are close to each other give way to what
# is taut between, which the engine could not bear
_HAND = 2e-3, 1.0
_ROUNDING = 1e-9  # of a number of steps
_WILD = 1e6       # rad/s: a faster joint is unstable
_SOFTEST = 0.5  # of the slowest frequency at first: a DLO in motion may look softer, or unstable
_FINE = 4         # points per cell at which the plane of a hole is looked for
_DIFFERENCE = 1e-5  # rad, step of difference quotients
_SIDES = 24         # of the polygon around a round hole, which is up to 0.9 % wider than the hole
_THINNEST = 1e-3    # m: a thinner sheet could be tunnelled through
_CONVEX = 1e-6      # of the volume: a mesh that is that near to its hull is convex
_MOST_PRISMS = 2000  # triangles of one that is not: each is a geom
_HALF_PLANE = 10.0  # m

Part = tuple[str, Sequence[float] | Floats, Floats, Floats]  # kind, size, center, rotation


@dataclass(frozen=True, eq=False, repr=False)
class Passage(Value):
    """Where a DLO pierces the plane of a cut-out."""

    depth: float  # arc length beyond the plane, m; 0: the DLO does not pierce it
    # largest distance from the center at which the DLO pierces the plane, m; nan if it does not
    miss: float
    y: float  # coordinates of that point in the axes of the cut-out, m
    z: float
    # distance of the DLO from the center, straight on as it is there, m: less than its miss where
    # it pierces the plane obliquely
    off: float


class Plant:
    """A DLO in a moving gripper. At first it hangs freely at rest, fallen from its natural shape.

    Rod, obstacles (a Sheet has one cut-out at most) and Pose are as the planner knows them and the
    gripper measures it; what is true instead, Truth and Course say, but for lag and friction, which
    are the robot's and the obstacles'. `damping` is the ratio of the slowest vibration at first, in
    proportion to the stiffness, and `least_damping` at least: the engine has some of its own. A
    `far_end`, clamped or pinned, is led there straight from where it hangs; so is what the first
    of the `hands` holds. Those are all the hands that come to hold the DLO, clamped, each at its
    place (`close`, `open`); one that does so at several places is as many of them. The `fittings`,
    clamped or pinned, take hold of whatever place comes to lie in them (`snap`); obstacles that
    are not there at first, as what shuts a fork, come when they are told to (`put`).

    Raises InvalidTask where the DLO touches an obstacle at first, NotConverged where it does not
    come to rest.
    """

    def __init__(self, rod: Rod, gripper: Pose, obstacles: Iterable[Obstacle] = (), *,
                 truth: Truth | None = None, cells: int = 40, step: float = 1e-3,
                 damping: float = 0.005, gravity: ArrayLike = _GRAVITY,
                 course: Course | None = None, far_end: FarEnd | None = None,
                 hands: Iterable[Hold] = (), fittings: Iterable[Hold] = ()) -> None:
        instance('rod', rod, Rod)
        instance('gripper', gripper, Pose)
        self.truth = Truth() if truth is None else instance('truth', truth, Truth)
        self._chain = chain_of(rod, self.truth, integer('cells', cells, minimum=4, maximum=200))
        instance('far_end', far_end, FarEnd, optional=True)
        if far_end is not None and far_end.grip not in ('clamped', 'pinned'):
            raise InvalidTask(f'far_end.grip = {far_end.grip!r}: expected clamped or pinned')
        self.hands = items('hands', hands, Hold)
        for hand in self.hands:
            if hand.grip != 'clamped' or hand.s is None:
                raise InvalidTask(f'hands: {hand!r}: expected clamped ones, each at a place s')
        self.fittings = items('fittings', fittings, Hold)
        for fitting in self.fittings:
            if fitting.grip not in ('clamped', 'pinned'):
                raise InvalidTask(f'fittings: {fitting!r}: expected clamped or pinned ones')
        # of those that are closed: where their DLO is, seen from where they are meant to be
        self._grasps: dict[int, Pose] = {}
        self._build(items('obstacles', obstacles, OBSTACLES), vector('gravity', gravity, 3),
                    far_end)
        self._step = number('step', step, above=0, maximum=0.01)
        self.time = 0.0
        self.measured = gripper  # where it truly is, Truth and Course say
        self.course = instance('course', course, Course, optional=True)
        self._turn = Rotation.from_rotvec(self.truth.gripper_turn.copy()).as_matrix()
        self._pushes: dict[int, Floats] = {}
        self._held = self._holding(gripper, 0.0)
        self._settle()
        self._damp(number('damping', damping, minimum=0))
        if far_end is not None:
            self._hold(far_end.pose, self.tip, 0)
        if self.hands:
            self._hold(self.hands[0].pose, self.grasped(0), self._hand(0))
            self._grasps[0] = Pose.identity()
        self._check_free()
        # (n,) N, sums of the sizes of each obstacle's contact forces, means over the
        # last `move`, as a sensor of that sampling time shows an impact; and the largest so far
        self.forces = np.zeros(len(self._obstacles))
        self.largest_forces = self.forces.copy()

    def grasped(self, hand: int) -> Pose:
        """Return the Pose of the DLO where one of the `hands`, by its index, holds it or would."""
        site = self._data.site(f'held {hand}')
        return Pose.from_rotation(site.xpos, site.xmat.reshape(3, 3))

    def close(self, hand: int, pose: Pose) -> float:
        """Close one of the `hands`, by its index, at a Pose: it takes the DLO as it is there.

        Returns how far the DLO is from where it is meant to be, m.
        """
        mujoco.mj_kinematics(self._model, self._data)
        there = self.grasped(hand)
        self._grasps[hand] = pose.inverse().compose(there)
        self._place_hand(self._hand(hand), there)
        self._data.eq_active[self._hand(hand)] = 1
        return float(np.linalg.norm(there.position - pose.position))

    def snap(self, fitting: int) -> float:
        """Let one of the `fittings`, by its index, hold what lies in it; return that place, m.

        It takes the DLO as it is there, and is a hand from then on, after the others: `move` may
        lead it into its seat.
        """
        k, seat = len(self.hands) + fitting, self.fittings[fitting].pose
        s = np.linspace(0, self._chain.length, _FINE * len(self._chain.masses) + 1)
        for _ in range(2):  # the second time between those
            away = np.linalg.norm(self._curve(s) - seat.position, axis=1)
            at = float(s[away.argmin()])
            s = np.clip(at + np.linspace(-1, 1, 101) * (s[1] - s[0]), 0, self._chain.length)
        piece, off = place_in(self._chain, at)
        site = self._model.site(f'held {k}').id
        self._model.site_bodyid[site] = self._model.body(f'piece {piece}').id
        self._model.site_pos[site] = (off, 0, 0)
        mujoco.mj_kinematics(self._model, self._data)
        self.close(k, self.grasped(k))
        return at

    def put(self, obstacle: int, there: bool = True) -> None:
        """Let one of the obstacles, by its index, be there, or not."""
        for geom, owner in enumerate(self._owner):
            if owner == obstacle:
                self._model.geom_contype[geom] = SCENE if there else 0
                self._model.geom_conaffinity[geom] = DLO if there else 0

    def open(self, hand: int) -> None:
        """Open one of the `hands`, by its index."""
        self._data.eq_active[self._hand(hand)] = 0
        self._grasps.pop(hand)

    def _hand(self, hand: int) -> int:
        """Return the number of a hand's equality, and of its body among those that are placed."""
        return int(self._model.neq) - len(self.hands) - len(self.fittings) + hand

    def _place_hand(self, grip: int, pose: Pose) -> None:
        self._data.mocap_pos[grip] = pose.position
        self._data.mocap_quat[grip] = np.roll(pose.quaternion, 1)

    def _placed_hand(self, grip: int) -> Pose:
        return Pose(self._data.mocap_pos[grip], np.roll(self._data.mocap_quat[grip], -1))

    def move(self, gripper: Pose, seconds: float, far_end: Pose | None = None,
             hands: Mapping[int, Pose] | None = None) -> None:
        """Move the gripper to a Pose in a time in s, evenly; the next call goes on from there.

        `far_end`: where the grip of the far end goes meanwhile, as evenly; None: it stays. So do
        those of the closed `hands`, by index.
        """
        instance('gripper', gripper, Pose)
        if instance('far_end', far_end, Pose, optional=True) and not self._hand(0):
            raise InvalidTask(f'far_end = {far_end!r}: expected none, the far end is free')
        seconds = number('seconds', seconds, above=0)
        begin, end = self._held, self._holding(gripper, self.time + seconds)
        turn = np.zeros(3)
        mujoco.mju_subQuat(turn, end[1], begin[1])
        steps = ceil(seconds / self._step * (1 - _ROUNDING))
        self._step_is(seconds / steps)
        self.forces[:] = 0
        # in world axes and gripper axes, as the engine has it
        twist = np.concatenate([end[0] - begin[0], turn]) / seconds
        quaternion = begin[1].copy()
        led = {} if far_end is None else {0: (self._placed_hand(0), far_end)}
        for hand, pose in (hands or {}).items():
            if hand not in self._grasps:
                raise InvalidTask(f'hands: {hand} is open: expected closed ones, '
                                  f'{sorted(self._grasps)}')
            led[self._hand(hand)] = (self._placed_hand(self._hand(hand)),
                                     pose.compose(self._grasps[hand]))
        for k in range(1, steps + 1):
            mujoco.mju_quatIntegrate(quaternion, twist[3:], seconds / steps)
            self._push(self.time + (k - 0.5) / steps * seconds)
            self._bend(self.time + k / steps * seconds)
            for grip, way in led.items():
                self._place_hand(grip, nearer(*way, k / steps))
            self._advance(begin[0] + k / steps * (end[0] - begin[0]), quaternion, twist)
        if not np.abs(self._data.qvel).max() < _WILD:
            raise NotConverged(f'the motion of the DLO became unstable at {self.time:.3g} s')
        self.forces /= steps
        np.maximum(self.largest_forces, self.forces, out=self.largest_forces)
        self._held = end
        self.time += seconds
        self.measured = gripper

    def points(self, s: ArrayLike) -> Floats:
        """Return the places (n, 3) in m of the DLO at true arc lengths s (n,) in m."""
        return self._curve(row('s', s, minimum=0, maximum=self._chain.length))

    @property
    def pull(self) -> float:
        """The force between gripper and DLO, N, as it is now."""
        mujoco.mj_rnePostConstraint(self._model, self._data)
        return float(self._chain.unit * np.linalg.norm(self._data.body('piece 0').cfrc_int[3:]))

    @property
    def length(self) -> float:
        """The true length of the DLO, m."""
        return self._chain.length

    @property
    def tip(self) -> Pose:
        """Pose of the free end, x axis = tangent."""
        place = self._nodes(self._data)[0][-1]
        return Pose.from_rotation(place, self._data.xmat[self._last + 1].reshape(3, 3))

    def passage(self, cutout: CutOut) -> Passage:
        """Return the Passage of a cut-out, at its true place (shifted by the Truth)."""
        instance('cutout', cutout, CutOut)
        s = np.linspace(0, self._chain.length, _FINE * len(self._chain.masses) + 1)
        known = [one.cutouts for one in self._sheets]  # a bore's mouth is the first
        number = known.index((cutout,)) if (cutout,) in known else 0
        return passage_of(cutout, s, self._curve(s) - self.truth.shift_of(number))

    def natural_frequencies(self, count: int = 3) -> Floats:
        """Return frequencies (count,), Hz, of small vibrations about this shape, no contacts."""
        count = integer('count', count, minimum=1, maximum=self._model.nv - 6)
        data = mujoco.MjData(self._model)
        data.qpos[:] = self._data.qpos
        squares, _ = eigh(*linear(self._model, data), subset_by_index=(0, count - 1))
        frequencies: Floats = np.sqrt(np.maximum(squares, 0)) / (2 * np.pi)
        return frequencies

    def _build(self, obstacles: Sequence[Obstacle], gravity: Floats,
               far_end: FarEnd | None) -> None:
        spec = mujoco.MjSpec()
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        spec.option.gravity = gravity
        gripper = add_gripper(spec, self._chain)
        self._fit(gripper)
        add_chain(gripper, self._chain)
        if far_end is not None:
            add_far_grip(spec, self._chain, far_end.grip)
        for k, hand in enumerate(self.hands):
            assert hand.s is not None  # judged when it was given
            add_grip(spec, self._chain, k, hand.s)
        for k, fitting in enumerate(self.fittings, start=len(self.hands)):
            add_grip(spec, self._chain, k, 0.5 * self._chain.length, fitting.grip)
        for k, obstacle in enumerate(obstacles):
            add_obstacle(spec, obstacle, k)
        self._obstacles = obstacles
        self._sheets = [one for one in obstacles if isinstance(one, Sheet)]
        self._model = model = spec.compile()
        self._stiffness = set_springs(model, self._chain)
        model.geom_solref[:], model.geom_solimp[:] = _STIFF_CONTACT
        model.eq_solref[:], model.eq_solimp[:] = _STIFF_CONTACT
        model.eq_solref[self._hand(0):] = _HAND
        names = [model.geom(k).name.split('/')[0] for k in range(model.ngeom)]
        self._owner = [int(name) if name else None for name in names]
        self._shift_sheets()
        self._last = len(self._chain.masses)  # of the bodies that are pieces
        self._data = mujoco.MjData(model)
        self._heavy = np.append(np.full(3, model.body_mass[1]), model.body_inertia[1])

    def _fit(self, gripper: Any) -> None:
        """Add what the gripper has, as a plug that it holds, to its body: here nothing."""

    def _shift_sheets(self) -> None:
        for geom, owner in enumerate(self._owner):
            if owner is not None and isinstance(sheet := self._obstacles[owner], Sheet):
                number = next(k for k, one in enumerate(self._sheets) if one is sheet)
                self._model.geom_pos[geom] += self.truth.shift_of(number)

    def _holding(self, gripper: Pose, time: float) -> tuple[Floats, Floats]:
        """Return where (3,) the DLO truly begins, and its quaternion w, x, y, z."""
        place = gripper.position + gripper.rotation @ self.truth.gripper_shift
        rotation = gripper.rotation @ self._turn
        if self.course is not None:
            place, rotation = self.course.held(place, rotation, time)
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, rotation.ravel())
        return place, quaternion

    def _place(self, place: Floats, quaternion: Floats) -> None:
        self._data.qpos[:3], self._data.qpos[3:7] = place, quaternion

    def _settle(self) -> None:
        """Let the DLO come to rest from its natural shape, with much damping and no obstacles."""
        self._data.qpos[7:] = self._model.qpos_spring[7:]
        self._come_to_rest()

    def _hold(self, pose: Pose, begin: Pose, grip: int) -> None:
        """Lead what a grip holds straight to a Pose, with much damping and no obstacles.

        `begin`: where it is; `grip`: the number of its equality, and of its body.
        """
        self._data.eq_active[grip] = 1
        self._come_to_rest([nearer(begin, pose, share)
                            for share in np.linspace(0, 1, _LED)], _STILL_HELD, grip)

    def _come_to_rest(self, leading: Sequence[Pose] = (), still: float = _STILL,
                      grip: int = 0) -> None:
        model, data = self._model, self._data
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        slowness = self._chain.slowness
        model.opt.timestep = _SETTLING * slowness
        model.dof_damping[6:] = slowness * self._stiffness
        for k in range(_LONGEST):
            if k < len(leading):
                self._place_hand(grip, leading[k])
            self._place(*self._held)
            data.qvel[:6] = 0
            mujoco.mj_step(model, data)
            speed = np.abs(data.qvel[6:]).max() * slowness
            data.qvel *= 1 - _DRAG
            if speed < still and k >= len(leading):
                break
        else:
            raise NotConverged(f'gripper = {self.measured!r}: the DLO does not come to rest in it')
        self._place(*self._held)
        data.qvel[:] = 0
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        mujoco.mj_forward(model, data)

    def _check_free(self) -> None:
        if self._data.ncon:
            raise InvalidTask(f'gripper = {self.measured!r}: expected a DLO that hangs freely, it '
                              'touches an obstacle there')

    def _damp(self, ratio: float) -> None:
        """Find the damping that the stiffness brings along: ratios, and s (`Rod.damping`)."""
        self.frequencies = self.natural_frequencies()  # (3,) Hz, about the shape at the beginning
        rate = np.pi * self.frequencies[0]
        self.least_damping = rate * 0.5 * self._step
        self.damping = max(ratio, self.least_damping)
        self.lag = self.damping / rate

    def _step_is(self, seconds: float) -> None:
        """Set the step of time. The engine's own damping, of a whole step, is part of the damping.

        What is left may be negative: stable while both together are half a step at least.
        """
        self._model.opt.timestep = seconds
        self._model.dof_damping[6:] = (self.lag - seconds) * self._stiffness

    def _advance(self, place: Floats, quaternion: Floats, twist: Floats) -> None:
        """Make one step; the gripper comes to a place and has a twist (6,) on the way there."""
        data = self._data
        data.qfrc_applied[:6] = self._heavy * (twist - data.qvel[:6]) / self._model.opt.timestep
        mujoco.mj_step(self._model, data)
        self._place(place, quaternion)
        data.qvel[:6] = twist
        if data.ncon:
            self._feel()

    def _push(self, time: float) -> None:
        """Let what bumps into the DLO at a time in s push it."""
        if self.course is None or not self.course.disturbances.bumps:
            return
        self._data.xfrc_applied[:] = 0
        for k, bump in enumerate(self.course.disturbances.bumps):
            size = self.course.push(bump, time)
            if size:
                if k not in self._pushes:
                    self._pushes[k] = self._force_of(bump)
                self._data.xfrc_applied[self._piece(bump), :3] += size * self._pushes[k]

    def _bend(self, time: float) -> None:
        """Set what the kinks until a time in s leave of the DLO's rest."""
        if self.course is None or not self.course.disturbances.kinks:
            return
        angles = self._chain.rest.copy()
        for kink in self.course.disturbances.kinks:
            joint = min(int(kink.place * len(angles)), len(angles) - 1)
            angles[joint, 1:] += self.course.bend(kink, time)
        set_rest(self._model, self._chain, angles)

    def _piece(self, bump: Bump) -> int:
        """Return the number of the body that is pushed."""
        count = len(self._chain.masses)
        return 1 + min(max(round(bump.place * count), 1), count)

    def _force_of(self, bump: Bump) -> Floats:
        """Return the largest force (3,) of a Bump over the unit of mass, m/s^2."""
        data, piece = mujoco.MjData(self._model), self._piece(bump)
        data.qpos[:] = self._data.qpos
        stiffness, mass = linear(self._model, data)
        squares, vectors = eigh(stiffness, mass)
        data.qpos[:] = self._data.qpos
        mujoco.mj_fwdPosition(self._model, data)
        lever = np.zeros((3, self._model.nv))
        mujoco.mj_jacBodyCom(self._model, data, lever, None, piece)
        tangent = data.xmat[piece].reshape(3, 3)[:, 0]
        across = bump.direction - (bump.direction @ tangent) * tangent
        moves = lever[:, 6:] @ vectors
        slowest = _SOFTEST * 2 * np.pi * self.frequencies[0]
        own = np.sqrt(np.maximum(squares, slowest**2))
        reached = (moves * (moves.T @ across)) @ bump.response(own, self.lag)
        largest = np.linalg.norm(reached, axis=0).max()
        return bump.displacement / largest * across if largest else np.zeros(3)

    def _feel(self) -> None:
        """Add up the contact forces."""
        data, wrench = self._data, np.zeros(6)
        for k, contact in enumerate(data.contact):
            mujoco.mj_contactForce(self._model, data, k, wrench)
            one, other = (self._owner[geom] for geom in contact.geom)
            size = self._chain.unit * np.linalg.norm(wrench[:3])
            self.forces[other if one is None else one] += size

    def _nodes(self, data: Any) -> tuple[Floats, Floats]:
        """Return places (n + 1, 3) and tangents (n + 1, 3) at the ends of the cells."""
        mujoco.mj_kinematics(self._model, data)
        own = slice(1, self._last + 2)
        tangents = data.xmat[own].reshape(-1, 3, 3)[:, :, 0].copy()
        places = data.xpos[own].copy()
        places[1:] += 0.5 * self._chain.cell * tangents[1:]
        return places, tangents

    def _curve(self, s: Floats) -> Floats:
        """Return places (n, 3) at arc lengths (n,), cubic between the nodes."""
        places, tangents = self._nodes(self._data)
        nodes = self._chain.cell * np.arange(len(places))
        curve: Floats = CubicHermiteSpline(nodes, places, tangents)(s)
        return curve


def passage_of(cutout: CutOut, s: Floats, places: Floats) -> Passage:
    """Return the Passage of a line, s (n,), places (n, 3), through a CutOut."""
    local = (places - cutout.center) @ cutout.pose.rotation
    before, after = local[:-1], local[1:]
    pierced = np.flatnonzero((before[:, 0] < 0) != (after[:, 0] < 0))
    if not pierced.size:
        return Passage(0.0, np.nan, np.nan, np.nan, np.nan)
    before, after = before[pierced], after[pierced]
    part = (before[:, 0] / (before[:, 0] - after[:, 0]))[:, None]
    places, ways = (before + part * (after - before))[:, 1:], after - before
    misses = np.linalg.norm(places, axis=1)
    first = s[pierced[0]] + part[0, 0] * (s[1] - s[0])
    worst = misses.argmax()
    off = np.linalg.norm(np.cross((0.0, *places[worst]), ways[worst])) / np.linalg.norm(ways[worst])
    y, z = map(float, places[worst])
    return Passage(float(s[-1] - first), float(misses[worst]), y, z, float(off))


def linear(model: Any, data: Any) -> tuple[Floats, Floats]:
    """Return the stiffness (by differences) and mass matrices of the joints about a rest."""
    size = model.nv - 6
    mujoco.mj_forward(model, data)
    mass = np.zeros((size, model.nv))
    for k in range(size):
        unit = np.zeros(model.nv)
        unit[6 + k] = 1
        mujoco.mj_mulM(model, data, mass[k], unit)
    rest, stiffness = data.qpos.copy(), np.zeros((size, size))
    for k in range(size):
        forces = []
        for sign in (1, -1):
            data.qpos[:] = rest
            data.qpos[7 + k] += sign * _DIFFERENCE
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            forces.append(data.qfrc_bias[6:] - data.qfrc_passive[6:])
        stiffness[k] = (forces[0] - forces[1]) / (2 * _DIFFERENCE)
    return 0.5 * (stiffness + stiffness.T), mass[:, 6:]


# ---- sheets and obstacles as bodies of the engine ----------------------------------------------


def add_obstacle(spec: mujoco.MjSpec, obstacle: Obstacle, number: int) -> None:
    """Add an obstacle to an MjSpec; the names of its geoms are 'number/part'."""
    if isinstance(obstacle, Mesh | Hull):
        _add_triangles(spec, number, obstacle)
        return
    for part, (kind, size, center, rotation) in enumerate(_parts(obstacle)):
        spec.worldbody.add_geom(
            name=f'{number}/{part}', type=getattr(mujoco.mjtGeom, f'mjGEOM_{kind}'), size=size,
            pos=center, quat=np.roll(Rotation.from_matrix(rotation).as_quat(), 1),
            contype=SCENE, conaffinity=DLO, condim=3 if obstacle.friction else 1,
            friction=(obstacle.friction, 0, 0))


def _add_triangles(spec: Any, number: int, obstacle: Mesh | Hull) -> None:
    """Add what consists of triangles: one convex geom, or a prism behind each triangle.

    MuJoCo takes a mesh as its convex hull.
    """
    vertices, faces = obstacle.surface
    whole = hull('obstacles', vertices)
    convex = volume(*obstacle.surface) > (1.0 - _CONVEX) * volume(*whole)
    if not convex and len(faces) > _MOST_PRISMS:
        raise InvalidTask(f'obstacles[{number}] = {obstacle!r}: expected at most {_MOST_PRISMS} '
                          'triangles of what is not convex in the cell; or Hulls, its convex parts')
    solids = [whole.vertices]
    if not convex:
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        areas = 0.5 * np.linalg.norm(normals, axis=1)
        corners = np.stack([a, b, c], axis=1)
        # half as deep as a plate of this volume and surface is thick
        depth = min(_THINNEST, volume(*obstacle.surface) / areas.sum())
        inwards = -0.5 * depth * normals / areas[:, None]
        solids = list(np.concatenate([corners, corners + inwards[:, None]], axis=1))
    turned = np.roll(obstacle.pose.quaternion, 1)
    for part, points in enumerate(solids):
        name = f'{number}/{part}'
        spec.add_mesh(name=name, uservert=np.ravel(points),
                      inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX)
        spec.worldbody.add_geom(
            name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, pos=obstacle.pose.position,
            quat=turned, contype=SCENE, conaffinity=DLO, condim=3 if obstacle.friction else 1,
            friction=(obstacle.friction, 0, 0))


def _parts(obstacle: Obstacle) -> list[Part]:
    """Return [(kind, size (3,), center (3,), rotation (3, 3))] of an obstacle."""
    if isinstance(obstacle, Plane):
        return [('PLANE', (_HALF_PLANE, _HALF_PLANE, 1), obstacle.point, _z_along(obstacle.normal))]
    if isinstance(obstacle, Capsule):
        axis = obstacle.end - obstacle.start
        return [('CAPSULE', (obstacle.radius, 0.5 * float(np.linalg.norm(axis)), 0),
                 0.5 * (obstacle.start + obstacle.end), _z_along(axis))]
    if isinstance(obstacle, Sheet):
        return _around_hole(obstacle)
    if not isinstance(obstacle, OBSTACLES):
        raise InvalidTask(f'obstacles: expected {", ".join(one.__name__ for one in OBSTACLES)}, '
                          f'got {obstacle!r}')
    return [(*_GEOMS[solid.kind](*solid.size), solid.pose.position, np.array(solid.pose.rotation))
            for solid in obstacle.solids]


# kind of a Solid -> its name in MuJoCo, and its size there
_GEOMS: dict[str, Callable[[float, float, float], tuple[str, Sequence[float]]]] = {
    'box': lambda x, y, z: ('BOX', (0.5 * x, 0.5 * y, 0.5 * z)),
    'ball': lambda x, y, z: ('SPHERE' if x == y == z else 'ELLIPSOID',
                             (0.5 * x, 0.5 * y, 0.5 * z)),
    'cylinder': lambda x, y, z: ('CYLINDER', (0.5 * x, 0.5 * z, 0))}


def _around_hole(sheet: Sheet) -> list[Part]:
    """Return the boxes of a Sheet."""
    half = 0.5 * np.array([max(sheet.thickness, _THINNEST), sheet.width, sheet.height])
    if not sheet.cutouts:
        return [('BOX', half, sheet.pose.position, np.array(sheet.pose.rotation))]
    if len(sheet.cutouts) > 1:
        raise InvalidTask(f'{sheet!r}: expected one cut-out at most, in the cell each has a sheet')
    hole = sheet.cutouts[0]
    rotation = np.array(hole.pose.rotation)
    reach = half[1:].min()  # the sheet is as wide in all directions
    if hole.radius is not None:
        turns = 2 * np.pi * np.arange(_SIDES) / _SIDES
        sides = [(angle, hole.radius, reach * np.tan(np.pi / _SIDES)) for angle in turns]
    else:
        y, z = 0.5 * float(hole.width or 0.0), 0.5 * float(hole.height or 0.0)
        sides = [(0, y, reach), (np.pi / 2, z, y), (np.pi, y, reach), (1.5 * np.pi, z, y)]
    parts: list[Part] = []
    for angle, inner, wide in sides:
        turned = rotation @ Rotation.from_euler('x', angle).as_matrix()
        center = hole.center + 0.5 * (inner + reach) * turned[:, 1]
        parts.append(('BOX', (half[0], 0.5 * (reach - inner), wide), center, turned))
    return parts


def _z_along(direction: Floats) -> Floats:
    """Return a rotation (3, 3) whose z axis is along a direction."""
    return Pose.looking_along((0.0, 0.0, 0.0), direction).rotation[:, [1, 2, 0]]
