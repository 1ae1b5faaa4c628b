# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Looks at a DLO (Observations) from files: YAML, tables of points (CSV), NumPy's arrays.

What a column or a key means is told by its name; what would have to be guessed is refused.
"""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from itertools import cycle
from math import nan
from pathlib import Path
from typing import Any, NamedTuple
from warnings import warn

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import DloPlannerError, DoubtfulInput, InvalidTask
from dlo_planner.extras import extra
from dlo_planner.identify.observation import Observation
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, choice, did_you_mean, known_keys, shown
from dlo_planner.model.files import readable, text_of
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.plain_poses import pose_of
from dlo_planner.model.pose import Pose
from dlo_planner.model.triangles import UNITS
from dlo_planner.settings.yaml_files import read_yaml

TABLES = ('.csv', '.tsv', '.txt', '.dat', '.xyz', '.npy', '.ply')
_LISTS = ('.yaml', '.yml', '.json')
_KEYS = ('gripper', 'points', 's', 'far_end', 'normal', 'initial', 'unit')
_AXES = ('x', 'y', 'z')
_PIXELS = ('u', 'v')  # of a photograph: to the right, and down
_PHOTOGRAPHS = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.heic', '.webp')
# columns that tell when: a look is of one time
_TIMES = ('time', 't', 'stamp', 'frame')
# columns that are known to tell nothing here: names of points, the rest of what
# `dlo-planner shape -o wire.csv` writes
_IDLE = ('id', 'name', 'label', 'index', 'point', 'marker', 'qx', 'qy', 'qz', 'qw', 'torsion',
         'curvature_n', 'curvature_b', 'tension', 'shear_n', 'shear_b', 'torque', 'moment_n',
         'moment_b')
_HEADING = re.compile(r'(?P<name>.*?)\s*(?:[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]|'
                      rf'(?:/\s*|\s|_)(?P<bare>{"|".join(UNITS)}))?')
_UNIT = re.compile(r'[\[(]?\s*(\w*)\s*[\])]?')  # a cell of a line of units
_PREFIXED = re.compile(r'(.*[._/ ])([xyzs])')
_SEPARATOR = re.compile(r'sep=.', re.IGNORECASE)  # a first line by which Excel is told
_DECIMAL_COMMA = re.compile(r'[-+]?\d*,\d+([eE][-+]?\d+)?')
_UNSEEN = ('', 'nan', 'null', 'none')  # in x, y and z: a point that a tracker did not see
_MOST_NAMED = 5  # lines
_MOST_ARRAY = 2**26  # bytes


class Photograph(NamedTuple):
    """What pixels of a photograph mean that shows a DLO from beside, in an upright plane."""

    u: float  # pixel at which the gripper is: from the left
    v: float  # and from the top
    size: float  # m, of a pixel in the plane of the DLO


def read_observations(paths: Sequence[Path], grippers: Sequence[Pose], unit: str = 'm',
                      photographs: Sequence[Photograph] = ()) -> list[Observation]:
    """Return the Observations of files.

    Parameters
    ----------
    paths : sequence of Path
        YAML or JSON files, each with its grippers; tables of points, .csv, .tsv, .txt, .dat, .xyz
        or .npy, or points of a .ply.
    grippers : sequence of Pose
        Pose of the gripper of each table.
    unit : str, optional
        Unit of lengths in tables that do not state theirs: 'm', 'cm', 'mm', 'in'.
    photographs : sequence of Photograph, optional
        What the pixels u and v mean of each table that has them, or of all of them. World x is to
        the right there, z is up, y was not measured.

    Raises
    ------
    InvalidTask
        A file says what cannot be understood, or would have to be guessed; the message names the
        file, and the line or key.
    """
    scale = UNITS[choice('unit', unit, UNITS)]
    other = next((path for path in paths if path.suffix.lower() not in TABLES + _LISTS), None)
    if other is not None:
        if other.suffix.lower() in _PHOTOGRAPHS:
            raise InvalidTask(
                f'{readable(other)}: expected points, not the picture: a table (.csv) with the '
                'pixels u,v of 10 to 30 places along the DLO, as any program for pictures shows '
                'them, and --pixels U,V,SIZE')
        raise InvalidTask(f'{readable(other)}: expected a file that ends with one of '
                          f'{" ".join(_LISTS)}, or as a table of points {" ".join(TABLES)}')
    tables = [path for path in paths if path.suffix.lower() in TABLES]
    if len(tables) != len(grippers):
        raise InvalidTask(f'--gripper was given {len(grippers)} times: expected once for each of '
                          f'the {len(tables)} tables of points ({", ".join(TABLES)}), as X,Y,Z')
    read = {path: _table(path, scale) for path in tables}
    pictures = [path for path, table in read.items()
                if isinstance(table, dict) and {*_PIXELS} <= table.keys()]
    if len(photographs) != len(pictures) and (len(photographs) != 1 or not pictures):
        raise InvalidTask(f'--pixels was given {len(photographs)} times: expected it once, or for '
                          f'each of the {len(pictures)} tables with pixels u, v, as U,V,SIZE: the '
                          'pixel at which the gripper is, and how many m a pixel is')
    meaning = dict(zip(pictures, photographs if len(photographs) > 1 else cycle(photographs),
                       strict=False))
    left, out = iter(grippers), list[Observation]()
    for path in paths:
        if path not in read:
            out += _of_yaml(path)
            continue
        gripper, table = next(left), read[path]
        if not isinstance(table, dict):
            out.append(_observation(str(path), gripper, {'points': table}))
            continue
        pictured = path in meaning
        if pictured:
            table = _measured(path, gripper, table, meaning[path])
        out.append(_look_of(path, gripper, table, pictured))
    return out


def _measured(path: Path, gripper: Pose, table: dict[str, Floats],
              photograph: Photograph) -> dict[str, Floats]:
    """Return a table with x and z in place of its pixels."""
    both = [axis for axis in _AXES if axis in table]
    if both:
        raise InvalidTask(f'{path}: expected pixels u, v or places, it has {", ".join(both)} too')
    rest = {name: values for name, values in table.items() if name not in _PIXELS}
    x, _, z = gripper.position
    return rest | {'x': x + photograph.size * (table['u'] - photograph.u),
                   'z': z - photograph.size * (table['v'] - photograph.v)}


# ---- YAML -----------------------------------------------------------------------------------


def _of_yaml(path: Path) -> list[Observation]:
    content = read_yaml(path)
    if isinstance(content, dict) and 'observations' in content:
        known_keys(str(path), content, ('observations',))
        content = content['observations']
    elif isinstance(content, dict):
        content = [content]
    if not isinstance(content, list) or not content:
        raise InvalidTask(f'{path}: expected a list of observations')
    return [_look(f'{path}[{k}]', one, path.parent) for k, one in enumerate(content)]


def _look(name: str, content: object, folder: Path) -> Observation:
    """Return the Observation of a look: {gripper: ..., points: ..., ...}."""
    if not isinstance(content, Mapping):
        raise InvalidTask(f'{name} = {shown(content)}: expected gripper: and points:')
    known_keys(name, content, _KEYS)
    if not {'gripper', 'points'} <= content.keys():
        raise InvalidTask(f'{name}: expected gripper: and points:')
    scale = UNITS[choice(f'{name}.unit', content.get('unit', 'm'), UNITS)]
    given = {key: content[key] for key in ('points', 's', 'normal') if content.get(key) is not None}
    for key in ('points', 's'):
        if key in given:
            given[key] = scale * array(f'{name}.{key}', given[key],
                                       (None, 3) if key == 'points' else (None,))
    if content.get('far_end') is not None:
        given['far_end'] = _far_end(f'{name}.far_end', content['far_end'])
    if content.get('initial') is not None:
        if not isinstance(content['initial'], str):
            raise InvalidTask(f'{name}.initial = {shown(content["initial"])}: expected the name of '
                              'a file with a Shape, .npz or .json')
        given['initial'] = Shape.load(folder / content['initial'])
    return _observation(name, pose_of(f'{name}.gripper', content['gripper']), given)


def _far_end(name: str, content: object) -> FarEnd:
    """Return a FarEnd: {pose, grip}; a pose, which clamps it; or a place (3,), which pins it."""
    if isinstance(content, Mapping) and 'position' not in content:
        known_keys(name, content, ('pose', 'grip'))
        if 'pose' not in content:
            raise InvalidTask(f'{name}: expected pose:, and grip: (clamped, pinned, sleeve or '
                              'aligned)')
        pose, grip = pose_of(f'{name}.pose', content['pose']), content.get('grip', 'clamped')
        try:
            return FarEnd(pose, grip)
        except InvalidTask as error:
            raise InvalidTask(f'{name}: {error}') from None
    pose = pose_of(name, content)
    return FarEnd(pose, 'pinned' if isinstance(content, list) and len(content) == 3 else 'clamped')


def _observation(name: str, gripper: Pose, given: Mapping[str, Any]) -> Observation:
    try:
        return Observation(gripper, **given)
    except DloPlannerError as error:
        raise InvalidTask(f'{name}: {error}') from None


# ---- tables of points -----------------------------------------------------------------------


class _Column(NamedTuple):
    """What a column of a table is."""

    name: str     # in small letters, without its unit
    scale: float  # m; 1 of what is no length


def _table(path: Path, scale: float) -> dict[str, Floats] | Floats:
    """Return the columns of a table by name, in m; or points (n, 3), which have none."""
    if path.suffix.lower() == '.npy':
        return _of_array(path, scale)
    if path.suffix.lower() == '.ply':
        return scale * _points_of(path)
    lines = _lines(path)
    delimiter = _delimiter(path, lines)
    rows = [(number, _cells(f'{path}, line {number}', line, delimiter)) for number, line in lines]
    columns: list[_Column] = []
    if rows and not all(_is_number(cell) for cell in rows[0][1]):
        where, names = f'{path}, line {rows[0][0]}', rows.pop(0)[1]
        units = [_UNIT.fullmatch(cell) for cell in rows[0][1]] if rows else []
        if len(units) == len(names) and any(one is not None and one[1] in UNITS for one in units):
            rows.pop(0)  # a line of units below the names
            names = [name if one is None or not one[1] else f'{name} [{one[1]}]'
                     for name, one in zip(names, units, strict=True)]
        columns = _columns(where, names, scale)
    elif rows and len(rows[0][1]) == len(_AXES):
        columns = [_Column(axis, scale) for axis in _AXES]
    elif rows:
        raise InvalidTask(
            f'{path}: expected x, y, z in a table without a heading, it has {len(rows[0][1])} '
            f'columns; say what they are in the first line, as id,x,y,z or s,x,y,z'
            f'{_ON_COMMAS if delimiter == "," else ""}')
    if not rows:
        raise InvalidTask(f'{path}: expected lines of x, y, z in m')
    return {column.name: column.scale * values for column, values in zip(
        columns, _numbers(path, rows, columns, delimiter).T, strict=True)}


_ON_COMMAS = ' (with a decimal comma, columns have to be separated by semicolons)'


def _look_of(path: Path, gripper: Pose, table: Mapping[str, Floats],
             pictured: bool = False) -> Observation:
    """Return the Observation of columns by name; `pictured`: of a photograph, without depth."""
    for name in _TIMES:
        if name in table and np.unique(table[name]).size > 1:
            raise InvalidTask(f'{path}: column {name} changes: expected points of a DLO at rest, '
                              'seen at one time')
    missing = [axis for axis in _AXES if axis not in table]
    if len(missing) > 1:
        raise InvalidTask(f'{path}: expected columns x, y and z, or two of them of a picture, or '
                          f'its pixels u, v, got {", ".join(table) or "none of them"}{_ON_COMMAS}')
    count = len(next(iter(table.values())))
    given: dict[str, Any] = {}
    others = [name for name in table if name not in (*_AXES, 's', *_TIMES, *_IDLE)]
    if missing and others:
        raise InvalidTask(f'{path}: expected a column {missing[0]}, or of a picture none that is '
                          f'not known, got {", ".join(table)}{did_you_mean(others[0], missing)}')
    if missing:
        if not pictured:  # a photograph has no third coordinate, and who says pixels knows that
            warn(f'{path}: a look without {missing[0]}, which counts as not measured',
                 DoubtfulInput, stacklevel=2)
        given['normal'] = np.eye(3)[_AXES.index(missing[0])]
    places = {axis: np.full(count, gripper.position[k]) for k, axis in enumerate(_AXES)} | {
        axis: table[axis] for axis in _AXES if axis in table}
    given['points'] = np.column_stack([places[axis] for axis in _AXES])
    if 's' in table:
        given['s'] = table['s']
    return _observation(str(path), gripper, given)


def _lines(path: Path) -> list[tuple[int, str]]:
    """Return the lines of a table that are not empty, with their numbers; # begins a comment.

    A first line of names may be one, as `numpy.savetxt` writes it.
    """
    out: list[tuple[int, str]] = []
    for number, line in enumerate(text_of(path).splitlines(), start=1):
        bare = line.strip()
        if not out and _SEPARATOR.fullmatch(bare):
            continue
        if bare.startswith('#'):
            bare = bare.lstrip('#').strip()
            if out or not {*_AXES} & {*re.findall(r'\w+', bare.lower())}:
                continue
        if bare:
            out.append((number, bare))
    return out


def _delimiter(path: Path, lines: Sequence[tuple[int, str]]) -> str:
    """Return what separates columns: of semicolons, tabs, commas, spaces the first there is."""
    text = '\n'.join(line for _, line in lines)
    if '"' in text and text.count('"') % 2:
        raise InvalidTask(f'{path}: expected lines of x, y, z, a quote is not closed')
    return next((one for one in ';\t,' if one in text), ' ')


def _cells(where: str, line: str, delimiter: str) -> list[str]:
    """Return the cells of a line."""
    if delimiter == ' ':
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    except csv.Error as error:  # a cell of more than 128 KiB
        raise InvalidTask(f'{where}: expected lines of x, y, z, {error}') from None


def _is_number(cell: str) -> bool:
    return _number(cell) is not None


def _number(cell: str) -> float | None:
    """Return a cell as a number, with a decimal point or comma; None if it is none.

    1_0, which Python takes for 10, is none.
    """
    if '_' in cell:
        return None
    if _DECIMAL_COMMA.fullmatch(cell):
        cell = cell.replace(',', '.')
    try:  # (Python reads 1_0 as 10, nobody else does)
        return None if '_' in cell else float(cell)
    except ValueError:
        return None


def _columns(where: str, cells: Sequence[str], scale: float) -> list[_Column]:
    """Return the Columns of a heading: `x`, `x [mm]`, `x (mm)`, `x / mm`, `x mm` or `x_mm`.

    What comes before all of x, y and z, as in `position.x` or `tip_x`, is left out, unless there
    are several such places.
    """
    out = []
    if any(map(_is_number, cells)):
        raise InvalidTask(f'{where}: expected numbers alone, or names of columns alone, as s,x,y,z')
    matches = [_HEADING.fullmatch(cell.strip().strip('"')) for cell in cells]
    found = ['' if match is None else match['name'].lower() for match in matches]
    prefix = _prefix(where, found)
    for cell, match, full in zip(cells, matches, found, strict=True):
        unit = None if match is None else match['unit'] or match['bare']
        name = full.removeprefix(prefix) if full[len(prefix):] in (*_AXES, 's') else full
        length = name in (*_AXES, 's')
        if length and unit is not None and unit not in UNITS:
            raise InvalidTask(f'{where}: {cell!r}: expected a unit out of {", ".join(UNITS)}')
        if name and name not in (*_AXES, *_PIXELS, 's', *_TIMES, *_IDLE):
            warn(f'{where}: column {cell!r} is not read{did_you_mean(name, (*_AXES, "s"))}',
                 DoubtfulInput, stacklevel=2)
        out.append(_Column(name, 1.0 if not length else scale if unit is None else UNITS[unit]))
    names = [column.name for column in out if column.name]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InvalidTask(f'{where}: column {twice!r}: expected once, it is there twice')
    return out


def _prefix(where: str, names: Sequence[str]) -> str:
    """Return what stands before x, y and z in a heading, '' if nothing does."""
    if {*_AXES} & {*names}:
        return ''
    known: dict[str, set[str]] = {}
    for name in names:
        match = _PREFIXED.fullmatch(name)
        if match is not None:
            known.setdefault(match[1], set()).add(match[2])
    places = [before for before, axes in known.items() if {*_AXES} <= axes]
    if len(places) > 1:
        raise InvalidTask(f'{where}: expected one place in each line, got '
                          f'{" and ".join(f"{one}x" for one in places)}; call that which is meant '
                          'x, y, z')
    return places[0] if places else ''


def _numbers(path: Path, rows: Sequence[tuple[int, list[str]]], columns: Sequence[_Column],
             delimiter: str) -> Floats:
    """Return the numbers (n, columns) of a table, nan in columns that are not read."""
    read = {*_AXES, *_PIXELS, 's', *_TIMES}
    written = {sign for _, cells in rows for cell in cells if _is_number(cell) for sign in ',.'
               if sign in cell}
    if len(written) == 2:  # noqa: PLR2004
        raise InvalidTask(f'{path}: expected decimal points or decimal commas, it has both')

    unseen = [number for number, cells in rows if len(cells) == len(columns) and all(
        cell.lower() in _UNSEEN for column, cell in zip(columns, cells, strict=True)
        if column.name in (*_AXES, *_PIXELS))]
    if unseen and len(unseen) < len(rows):
        warn(f'{path}: left out as not seen, without x, y and z: line '
             f'{", ".join(map(str, unseen[:_MOST_NAMED]))}'
             f'{" ..." if len(unseen) > _MOST_NAMED else ""}', DoubtfulInput, stacklevel=2)
        rows = [row for row in rows if row[0] not in {*unseen}]

    def values() -> Iterator[list[float]]:
        for number, cells in rows:
            where = f'{path}, line {number}'
            if len(cells) != len(columns):
                raise InvalidTask(
                    f'{where}: expected {len(columns)} columns as in the first line, '
                    f'{", ".join(column.name for column in columns)}, got {len(cells)}'
                    f'{_ON_COMMAS if delimiter == "," and len(cells) > len(columns) else ""}')
            line = []
            for column, cell in zip(columns, cells, strict=True):
                value = _number(cell) if column.name in read else nan
                if value is None or column.name in read and not np.isfinite(value):
                    raise InvalidTask(f'{where}: {column.name} = {shown(cell)}: expected a finite '
                                      'number')
                line.append(value)
            yield line

    return np.array(list(values()))


def _of_array(path: Path, scale: float) -> dict[str, Floats] | Floats:
    """Return what a file of NumPy's has: (n, 3), or fields x, y, z and s."""
    try:
        content = np.load(BytesIO(readable(path, _MOST_ARRAY).read_bytes()), allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InvalidTask(f'{path}: expected an array of NumPy with points (n, 3), {error}'
                          ) from None
    names = getattr(getattr(content, 'dtype', None), 'names', None)
    if not names:
        return scale * array(str(path), content, (None, 3))
    columns = _columns(str(path), names, scale)
    return {column.name: column.scale * array(f'{path}: {name}', content[name], (None,))
            for column, name in zip(columns, names, strict=True)}


def _points_of(path: Path) -> Floats:
    """Return the points (n, 3) of a PLY file."""
    trimesh = extra('trimesh', 'mesh', 'files of points (.ply)')
    content = readable(path, _MOST_ARRAY).read_bytes()
    try:
        found = trimesh.load(BytesIO(content), file_type='ply', process=False).vertices
    except Exception as error:  # whatever a reader raises on what is no such file
        raise InvalidTask(f'{path}: expected points of a .ply file, {type(error).__name__}: '
                          f'{shown(str(error))}') from None
    return array(str(path), np.array(found), (None, 3))
