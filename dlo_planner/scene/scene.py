# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What stands in a cell: read from the files that people have, and written for other planners."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import warn

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import DoubtfulInput, InvalidTask
from dlo_planner.model.checks import (
    choice,
    did_you_mean,
    flag,
    instance,
    items,
    number,
    shown,
)
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.files import readable, writable
from dlo_planner.model.obstacles import OBSTACLES, Capsule, Mesh, Obstacle, Sheet
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Surface
from dlo_planner.model.triangles import KINDS_OF_FILE, UNITS
from dlo_planner.model.value import Value, brief, put
from dlo_planner.scene import engine, lists, moveit, triangles
from dlo_planner.scene.content import Asked, Content, counted, moved, moved_cutout

_LISTS = ('.yaml', '.yml', '.json')
_WRITTEN = ('.scene', '.xml', '.yaml')
_ROUND = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))  # half a turn about z
_LOOKS = 17  # places of an element at which a radius that varies is looked at
_DEEPEST = 8  # files that name each other
_MOST_NAMES = 5  # in a note
_INSTEAD = {  # endings of files of cells that nothing here reads -> what would be right
    '.xacro': 'the URDF that it makes: xacro cell.urdf.xacro > cell.urdf',
    **dict.fromkeys(('.step', '.stp', '.iges', '.igs', '.sldprt', '.sldasm', '.ipt', '.f3d'),
                    'triangles of it: CAD programs export STL or 3MF'),
    **dict.fromkeys(('.usd', '.usda', '.usdc', '.usdz', '.dae', '.fbx', '.blend', '.gltf'),
                    'its triangles as GLB'),
    **dict.fromkeys(('.sdf', '.world'), 'URDF or MJCF of it'),
    '.srdf': 'the URDF beside it',
    **dict.fromkeys(('.pcd', '.las', '.xyz', '.npy', '.csv'),
                    'solids, these are points: a closed surface of them would be read as STL; '
                    'points of a DLO are for identify')}


if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Scene(Value):
    """What stands in a cell: obstacles with names, and the holes in them.

    Attributes
    ----------
    obstacles : tuple of obstacle
        What a DLO may touch, in m, each with a name of its own. One that is given without a name
        gets its class and number, as 'box 3'.
    cutouts : tuple of CutOut
        Holes that a DLO may be threaded through: those of the sheets among the obstacles, and what
        else was given.
    notes : tuple of str
        What has to be known of how a file was read: a unit that was assumed, what does not count.
        Scenes are equal without it, and whatever their obstacles are called.

    Raises
    ------
    InvalidTask
        Two obstacles have one name.
    """

    obstacles: tuple[Obstacle, ...] = ()
    cutouts: tuple[CutOut, ...] = ()
    notes: tuple[str, ...] = field(default=(), compare=False)

    if TYPE_CHECKING:  # what may be given
        def __init__(self, obstacles: Iterable[Obstacle] = (), cutouts: Iterable[CutOut] = (),
                     notes: Iterable[str] = ()) -> None: ...

    def __post_init__(self) -> None:
        known = items('Scene.obstacles', self.obstacles, OBSTACLES)
        named = tuple(one if one.name else replace(one, name=f'{type(one).__name__.lower()} {k}')
                      for k, one in enumerate(known))
        twice = [name for name, count in Counter(one.name for one in named).items() if count > 1]
        if twice:
            raise InvalidTask(f'Scene.obstacles: expected a name of its own for each, '
                              f'{Counter(one.name for one in named)[twice[0]]} are called '
                              f'{shown(twice[0])}')
        own = [hole for one in named if isinstance(one, Sheet) for hole in one.cutouts]
        more = [one for one in items('Scene.cutouts', self.cutouts, CutOut) if one not in own]
        put(self, obstacles=named, cutouts=(*own, *more),
            notes=items('Scene.notes', self.notes, str))
        super().__post_init__()

    def __repr__(self) -> str:
        return brief(self, self.counts)

    @property
    def counts(self) -> str:
        """How much is in it, in words."""
        return (f'{counted(len(self.obstacles), "obstacle")}, '
                f'{counted(len(self.cutouts), "cut-out")}')

    def __getitem__(self, name: str) -> Obstacle:
        """Return the obstacle that is called so."""
        instance('name', name, str)
        found = next((one for one in self.obstacles if one.name == name), None)
        if found is None:
            names = [one.name for one in self.obstacles]
            raise InvalidTask(f'name = {shown(name)}: expected one of the {len(names)} obstacles'
                              f'{did_you_mean(name, names)}')
        return found

    @property
    def cutout_names(self) -> tuple[str, ...]:
        """How the cut-outs are called: by their sheet, with a number if it has several."""
        names = []
        for one in self.obstacles:
            count = len(one.cutouts) if isinstance(one, Sheet) else 0
            names += [one.name] if count == 1 else [f'{one.name}/{k}' for k in range(count)]
        return (*names, *(f'cut-out {k}' for k in range(len(names), len(self.cutouts))))

    def cutout(self, name: str) -> CutOut:
        """Return a cut-out by its name, as `Thread` takes it.

        Parameters
        ----------
        name : str
            One of `cutout_names`.

        Returns
        -------
        CutOut

        Raises
        ------
        InvalidTask
            None is called so.
        """
        instance('name', name, str)
        names = self.cutout_names
        if name not in names:
            known = f'one of the cut-outs {", ".join(names)}' if names else (
                'no name of a cut-out, there is none')
            raise InvalidTask(f'name = {shown(name)}: expected {known}{did_you_mean(name, names)}')
        return self.cutouts[names.index(name)]

    def turned(self, name: str) -> Scene:
        """Return the scene with a cut-out turned round: a DLO goes through it from behind.

        Parameters
        ----------
        name : str
            One of `cutout_names`.

        Returns
        -------
        Scene

        Raises
        ------
        InvalidTask
            None is called so.
        """
        before = self.cutout(name)
        after = replace(before, pose=before.pose.compose(_ROUND))
        obstacles = [replace(one, cutouts=tuple(after if hole is before else hole
                                                for hole in one.cutouts))
                     if isinstance(one, Sheet) else one for one in self.obstacles]
        return Scene(obstacles, [after if hole is before else hole for hole in self.cutouts],
                     self.notes)

    @classmethod
    def read(cls, path: str | PathLike[str], unit: str | None = None, *,
             pose: Pose = Pose.identity(), friction: float = 0.0,  # noqa: B008 - frozen
             joints: Mapping[str, Any] | None = None, hulls: bool = False) -> Scene:
        """Return what a file of a cell says.

        MoveIt's `.scene`, MJCF (`.xml`), URDF (`.urdf`), triangles (`.stl .obj .ply .glb .3mf`),
        and YAML with obstacles by their fields or with files (`- file: cell.xml`).

        Parameters
        ----------
        path : str or PathLike
            File; its ending says what it is.
        unit : str, optional
            Unit of its lengths: 'm', 'cm', 'mm' or 'in'. If None, what the file or its format says:
            m, of 3MF what is stated there, and of STL, OBJ and PLY, which state none, mm.
        pose : Pose, optional
            Where the frame of the file stands in the world.
        friction : float, optional
            Coulomb's coefficient of obstacles that state none, >= 0.
        joints : dict, optional
            Where the joints of an MJCF or URDF stand: name -> m or rad (of a ball joint or a free
            one its 4 or 7 numbers).
        hulls : bool, optional
            Whether triangles that do not enclose a solid are taken as their convex hull, which is
            noted; else they are refused. Those of MJCF always are, as MuJoCo takes them.

        Returns
        -------
        Scene
            What was assumed or does not count is in its notes.

        Raises
        ------
        InvalidTask
            What is wrong with the file, where, and what would be right. Nothing that stands in the
            way is left out: an unknown shape, a joint of which nobody says where it stands, or
            triangles that do not enclose a solid are refused.
        MissingExtra
            A package that reads such files is not there.
        """
        instance('pose', pose, Pose)
        if unit is not None:
            choice('unit', unit, UNITS)
        asked = Asked(unit, number('friction', friction, minimum=0),
                      instance('joints', joints, Mapping, optional=True) or {},
                      flag('hulls', hulls))
        content = _read(readable(path), asked)
        obstacles, renamed = _with_own_names(content.obstacles)
        if pose != Pose.identity():
            obstacles = [moved(one, pose) for one in obstacles]
            content.cutouts = [moved_cutout(one, pose) for one in content.cutouts]
        return cls(obstacles, content.cutouts, (*dict.fromkeys(content.notes), *renamed,
                                                *_unnamed_holes(obstacles)))

    def write(self, path: str | PathLike[str]) -> None:
        """Write the obstacles for other planners; `read` reads them as they were.

        Parameters
        ----------
        path : str or PathLike
            `.scene` for MoveIt, `.xml` for MuJoCo (MJCF, which keeps meshes in single precision)
            or `.yaml`. Cut-outs that are in no sheet are written to YAML alone, which is said by
            the warning DoubtfulInput.

        Raises
        ------
        InvalidTask
            Another ending, or a file that cannot be written.
        """
        target = writable(path)
        ending = target.suffix.lower()
        if ending not in _WRITTEN:
            raise InvalidTask(f'path = {shown(str(path))}: expected a file that ends with one of '
                              f'{" ".join(_WRITTEN)}')
        own = [hole for one in self.obstacles if isinstance(one, Sheet) for hole in one.cutouts]
        more = tuple(one for one in self.cutouts if one not in own)
        if more and ending != '.yaml':
            warn(f'{target}: {len(more)} cut-outs that are in no sheet are not written, .yaml '
                 'would keep them', DoubtfulInput, stacklevel=2)
        text = lists.text_of_list(self.obstacles, more) if ending == '.yaml' else (
            moveit.text_of_scene if ending == '.scene' else engine.text_of_mjcf)(
                self.obstacles, target.stem)
        try:
            target.write_text(text, encoding='utf-8')
        except OSError as error:
            raise InvalidTask(f'path = {shown(str(path))}: expected a file to write, {error}'
                              ) from None

    def joined(self, other: Scene) -> Scene:
        """Return the scene of both; a name that is in both gets a number in the other one.

        Parameters
        ----------
        other : Scene

        Returns
        -------
        Scene
        """
        instance('other', other, Scene)
        obstacles, renamed = _with_own_names([*self.obstacles, *other.obstacles])
        return Scene(obstacles, (*self.cutouts, *other.cutouts),
                     tuple(dict.fromkeys([*self.notes, *other.notes, *renamed])))

    def with_dlo(self, shape: Shape, name: str = 'dlo') -> Scene:
        """Return the scene with a DLO as capsules, for planners that shall keep clear of it.

        One capsule from node to node, named 'dlo/0', 'dlo/1', ...; wider than the DLO by what it
        is bent in between, so that they contain it.

        Parameters
        ----------
        shape : Shape
            Where the DLO is, of a rod with a radius.
        name : str, optional
            How it is called.

        Returns
        -------
        Scene

        Raises
        ------
        InvalidTask
            The radius of the DLO is not known.
        """
        instance('shape', shape, Shape)
        instance('name', name, str)
        rod = shape.rod
        if rod is None or rod.radius is None:
            raise InvalidTask(f'shape = {shown(shape)}: expected the shape of a rod with a radius; '
                              'of one from a file it is not known')
        surface = Surface.of(rod)
        radii = np.full(len(shape.s) - 1, surface.bound) if surface.rod is None else (
            rod.radii(np.linspace(shape.s[:-1], shape.s[1:], _LOOKS).ravel()).reshape(
                _LOOKS, -1).max(axis=0))
        bends = np.linalg.norm(shape.element_strains[:, 1:], axis=1)
        # an arc of length h and curvature k is k h^2 / 8 off its chord, and a little less
        wide = radii + bends * np.diff(shape.s) ** 2 / 8
        return self.joined(Scene([
            Capsule(start, end, float(radius), name=f'{name}/{k}')
            for k, (start, end, radius) in enumerate(zip(
                shape.positions[:-1], shape.positions[1:], wide, strict=True))]))

    def plot(self, ax: Axes | None = None) -> Figure:
        """Return a picture of obstacles and cut-outs in space.

        Parameters
        ----------
        ax : Axes, optional
            Axes of matplotlib to draw in, with `projection='3d'`. If None, a new figure is made.

        Returns
        -------
        Figure
            Figure of matplotlib.

        Raises
        ------
        MissingExtra
            Matplotlib is not there (extra `figures`).
        """
        from dlo_planner.scene.picture import plot  # noqa: PLC0415  (a planner draws nothing)
        return plot(self.obstacles, self.cutouts, ax)

    def summary(self) -> str:
        """Return a table as text: obstacles, cut-outs as the terminal takes them, and notes."""
        from dlo_planner.scene.table import table_of  # noqa: PLC0415  (no reader needs it)
        return table_of(self.counts, self.obstacles,
                        dict(zip(self.cutout_names, self.cutouts, strict=True)), self.notes)


def _read(path: Path, asked: Asked, depth: int = 0) -> Content:
    """Return what a file says, in m."""
    ending = path.suffix.lower()
    readable(path)
    if ending in KINDS_OF_FILE:
        return triangles.read(path, asked)
    if ending in _LISTS:
        if depth == _DEEPEST:
            raise InvalidTask(f'{path}: expected at most {_DEEPEST} files that name each other')
        return lists.read(path, asked, lambda file, what: _read(file, what, depth + 1))
    reader = _READERS.get(ending)
    if reader is None:
        wanted = _INSTEAD.get(ending, 'a file that ends with one of '
                              f'{" ".join((*_READERS, *KINDS_OF_FILE, *_LISTS))}')
        raise InvalidTask(f'{path}: expected {wanted}')
    return reader(path, asked)


_READERS: dict[str, Callable[[Path, Asked], Content]] = {
    '.scene': moveit.read, '.xml': engine.read, '.mjcf': engine.read, '.urdf': engine.read}


def _unnamed_holes(obstacles: Iterable[Obstacle]) -> list[str]:
    """Return a note on the meshes that have holes through them, none of which is a cut-out.

    Of a closed surface vertices less edges plus faces are 2, and 2 less for each hole through it.
    """
    names = [repr(one.name) for one in obstacles if isinstance(one, Mesh)
             and len(one.vertices) - len(one.faces) // 2 < 2]
    if not names:
        return []
    listed = ', '.join(names[:_MOST_NAMES]) + (', ...' if len(names) > _MOST_NAMES else '')
    return [f'{listed}: holes through it, but no cut-out: these are those of plates with a '
            'rectangular outline that are round (by 12 corners or more) or rectangular; say others '
            'by their center, direction and radius']


def _with_own_names(obstacles: Iterable[Obstacle]) -> tuple[list[Obstacle], list[str]]:
    """Return obstacles of which none has the name of another one, and what was renamed."""
    known, out, renamed = set[str](), list[Obstacle](), list[str]()
    for one in obstacles:
        name, k = one.name, 2
        while name and name in known:
            name, k = f'{one.name} ({k})', k + 1
        known.add(name)
        if name != one.name:
            renamed.append(f'another {one.name!r} is called {name!r}')
        out.append(one if name == one.name else replace(one, name=name))
    return out, renamed
