# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""MJCF and URDF: geoms as MuJoCo's own reader places them; and MJCF of obstacles.

What collides is read. A joint stands where it is told to, or the file is refused: a gripper whose
fingers are elsewhere is another obstacle.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.extras import extra
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import did_you_mean, number, row, shown
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.files import text_of
from dlo_planner.model.obstacles import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Hull,
    Mesh,
    Obstacle,
    Plane,
    Sheet,
    Sphere,
)
from dlo_planner.model.pose import Pose
from dlo_planner.model.triangles import KINDS_OF_FILE, Surface, joined, load
from dlo_planner.scene.content import Asked, Content, counted, moved, pierced, solids_of
from dlo_planner.scene.plates import pieces_of

_LARGEST = 2**28  # bytes of a file
_UNSAID = 0.123456789  # friction of geoms that state none: nobody writes that
_MESH = 'mesh:'  # begins the name of a collision that is one, for the time of reading
_KINDS = ('plane', 'height field', 'sphere', 'capsule', 'ellipsoid', 'cylinder', 'box', 'mesh',
          'SDF')  # of geoms, by their numbers in MuJoCo
_WIDTHS = {'free': 7, 'ball': 4, 'slide': 1, 'hinge': 1}  # numbers that say where a joint stands
_JOINTS = tuple(_WIDTHS)  # by their numbers in MuJoCo
_FRAME = re.compile(r'(.*/)?cutout[^/]*')
_DIGITS = 17  # with which a number is read back as it was
# how a mesh is called that `text_of_mjcf` writes: MJCF knows no difference
_MESHES = {Hull: 'hull:', (Mesh, True): 'smooth mesh:', (Mesh, False): 'mesh:'}


def read(path: Path, asked: Asked) -> Content:
    """Return what an MJCF or URDF file says, in m.

    Raises
    ------
    InvalidTask
        What MuJoCo does not read, with its words; a joint of which nobody says where it stands; a
        geom that is no obstacle here.
    MissingExtra
        MuJoCo is not there.
    """
    mujoco = extra('mujoco', 'scene', 'MJCF and URDF files')
    text = _text(path)
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InvalidTask(f'{path}: expected XML, {error}') from None
    if root.tag not in ('mujoco', 'robot'):
        raise InvalidTask(f'{path}: expected MJCF (<mujoco>) or URDF (<robot>), got '
                          f'<{shown(root.tag)[1:-1]}>')
    content, meshes = Content(), dict[str, Surface]()
    if root.tag == 'robot':
        text, meshes = _collisions(path, root, content)
    try:
        if root.tag == 'robot':
            spec = mujoco.MjSpec.from_string(text)
            spec.compiler.fusestatic = False  # geoms are called by their links
        else:
            spec = mujoco.MjSpec.from_file(str(path))
            _without_textures(spec, content)
        _with_any_mass(mujoco, spec)
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise InvalidTask(f'{path}: MuJoCo does not read it: {" ".join(str(error).split())}'
                          ) from None
    if model.nflex:
        raise InvalidTask(f'{path}: expected rigid geoms, it has {model.nflex} of what bends '
                          '(flex)')
    if model.nskin:
        content.notes.append(f'not read: {counted(model.nskin, "skin")}, it is for show')
    data = mujoco.MjData(model)
    _stand(path, model, data, _with_mimics(root, asked.joints), _mimics(root))
    mujoco.mj_kinematics(model, data)
    said = _frictions(mujoco, text, path, model, content) if root.tag == 'mujoco' else (
        np.full(model.ngeom, np.nan))
    _Geoms(path, model, data, np.where(np.isnan(said), asked.friction, said), meshes, asked,
           content).read()
    return content.scaled(asked.unit)


def _text(path: Path) -> str:
    """Return the text of an XML file in UTF-8, without the line that states so."""
    return re.sub(r'^\s*<\?xml.*?\?>', '', text_of(path, _LARGEST), flags=re.DOTALL)


def _without_textures(spec: Any, content: Content) -> None:
    """Take textures and materials out of a spec: their files may not be there, and do not count."""
    count = len(spec.textures)
    for one in (*spec.geoms, *spec.sites):
        one.material = ''
    for one in (*spec.materials, *spec.textures):
        spec.delete(one)
    if count:
        content.notes.append(f'not read: {counted(count, "texture")}')


def _with_any_mass(mujoco: Any, spec: Any) -> None:
    """Give bodies a mass: what stands still needs none, and MuJoCo refuses links without one."""
    for body in spec.bodies[1:]:
        body.explicitinertial, body.mass, body.inertia = True, 1.0, (1.0, 1.0, 1.0)
        body.ipos, body.iquat, body.fullinertia = (0, 0, 0), (1, 0, 0, 0), np.full(6, np.nan)
    for mesh in spec.meshes:  # one that is thin or open has no volume
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


# ---- URDF ------------------------------------------------------------------------------------


def _collisions(path: Path, root: ElementTree.Element,
                content: Content) -> tuple[str, dict[str, Surface]]:
    """Return the text of a URDF with its collisions alone, and the meshes among them, in m.

    In the place of a mesh is a ball: MuJoCo says where it is. The mesh is known by its name there.
    """
    seen = 0
    for link in root.iter('link'):
        for one in link.findall('visual'):
            link.remove(one)
            seen += 1
    if not any(link.find('collision') is not None for link in root.iter('link')):
        raise InvalidTask(f'{path}: expected <collision> in a <link>, it has none'
                          f'{f", and {seen} <visual>, which do not collide" if seen else ""}')
    if seen:
        content.notes.append(f'not read: {counted(seen, "visual")}, collisions alone are obstacles')
    meshes: dict[str, Surface] = {}
    for collision in root.iter('collision'):
        geometry = collision.find('geometry')
        mesh = None if geometry is None else geometry.find('mesh')
        if geometry is None or mesh is None:
            continue
        named = mesh.get('filename', '')
        file = _resolved(path, named)
        if file is None:
            raise InvalidTask(f'{path}: mesh {shown(named)}: expected a file beside it, in a '
                              'folder above it, or in a package of AMENT_PREFIX_PATH')
        if file.suffix.lower() not in KINDS_OF_FILE:
            raise InvalidTask(f'{path}: mesh {shown(named)}: expected one of '
                              f'{" ".join(KINDS_OF_FILE)}, to which Blender or assimp convert it')
        try:
            scale = np.array([float(part) for part in mesh.get('scale', '1 1 1').split()])
            surface = joined(load(file).parts, scale)
        except ValueError as error:
            raise InvalidTask(f'{path}: mesh {shown(named)}: expected triangles and a scale of '
                              f'three numbers, {error}') from None
        key = f'{_MESH}{len(meshes)} {collision.get("name", "")}'
        collision.set('name', key)
        meshes[key] = surface
        geometry.remove(mesh)
        ElementTree.SubElement(geometry, 'sphere', radius='1')
    return ElementTree.tostring(root, encoding='unicode'), meshes


def _resolved(path: Path, named: str) -> Path | None:
    """Return the file that a URDF means; None if it is nowhere."""
    scheme, _, rest = named.rpartition('://')
    above = [path.absolute().parent, *path.absolute().parent.parents]
    if scheme == 'package':
        package, _, inner = rest.partition('/')
        shares = [Path(prefix) / 'share' / package
                  for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if prefix]
        tried = [*(folder / inner for folder in above if folder.name == package),
                 *(folder / package / inner for folder in above),
                 *(share / inner for share in shares)]
    else:
        tried = [above[0] / rest]
    return next((one for one in tried if one.is_file()), None)


# ---- joints ----------------------------------------------------------------------------------


def _mimics(root: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """Return what URDF says of joints that follow another one, by their names."""
    return {joint.get('name', ''): mimic for joint in root.iter('joint')
            if joint.get('type') != 'fixed' and (mimic := joint.find('mimic')) is not None}


def _with_mimics(root: ElementTree.Element, joints: Mapping[str, Any]) -> dict[str, Any]:
    """Return where joints stand, those that follow another one with it, unless they are given."""
    out, left = dict(joints), _mimics(root)
    while ready := [name for name, mimic in left.items() if mimic.get('joint') in out]:
        for name in ready:
            mimic = left.pop(name)
            leader = number(f'joints[{mimic.get("joint")!r}]', out[mimic.get('joint', '')])
            # which MuJoCo has judged to be numbers
            factor, offset = float(mimic.get('multiplier', 1)), float(mimic.get('offset', 0))
            out.setdefault(name, factor * leader + offset)
    return out


def _stand(path: Path, model: Any, data: Any, joints: Mapping[str, Any],
           followers: Iterable[str]) -> None:
    """Set the joints of a model where they are told to stand; refuse one of which nobody says.

    `followers` follow others, of which it has to be said.
    """
    names = [model.joint(k).name or f'joint {k} of body {_body(model, model.jnt_bodyid[k])}'
             for k in range(model.njnt)]
    for name in joints:
        if name not in names:
            known = f'one of {", ".join(map(repr, names))}' if names else 'none'
            raise InvalidTask(f'joints: {shown(name)}: expected {known}, which {path} has'
                              f'{did_you_mean(name, names)}')
    left = [k for k, name in enumerate(names) if name not in joints]
    left = [k for k in left if names[k] not in followers] or left
    if left:
        within = {names[k]: min(max(0.0, model.jnt_range[k][0]), model.jnt_range[k][1])
                  if model.jnt_limited[k] else 0.0 for k in left}
        said = ', '.join(f'{name!r}: {value:g}' for name, value in within.items())
        options = ' '.join(f'--joint "{name}={value:g}"' for name, value in within.items())
        listed = ', '.join(_told(model, k, names[k]) for k in left)
        raise InvalidTask(
            f'{path}: expected what stands still, but nobody says where '
            f'{counted(len(left), "joint")} of it {"stands" if len(left) == 1 else "stand"}: '
            f'{listed}. Say it by joints={{{said}}}, on the terminal {options}')
    for k, name in enumerate(names):
        first, width = model.jnt_qposadr[k], _WIDTHS[_JOINTS[model.jnt_type[k]]]
        data.qpos[first:first + width] = row(f'joints[{name!r}]', joints[name], least=width,
                                             most=width)
        low, high = model.jnt_range[k]
        if model.jnt_limited[k] and width == 1 and not low <= data.qpos[first] <= high:
            raise InvalidTask(f'joints[{name!r}] = {data.qpos[first]:g}: expected {low:g} to '
                              f'{high:g}, as {path} says')


def _told(model: Any, k: int, name: str) -> str:
    """Return a joint in words: name, kind, and its limits."""
    kind, (low, high) = _JOINTS[model.jnt_type[k]], model.jnt_range[k]
    unit = {'slide': ' m', 'hinge': ' rad'}.get(kind, '')
    limits = f', {low:g} to {high:g}{unit}' if model.jnt_limited[k] else ''
    return f'{name!r} ({kind}{limits})'


def _body(model: Any, number: int) -> str:
    return str(model.body(int(number)).name)


# ---- geoms -----------------------------------------------------------------------------------


def _frictions(mujoco: Any, text: str, path: Path, model: Any, content: Content) -> Floats:
    """Return friction (ngeom,) of geoms, nan where the file states none.

    MuJoCo does not tell a default from what is stated: read once more with another default.
    """
    head = re.search(r'<mujoco\b[^>]*?(/?)>', text)
    assert head is not None
    other = (f'{text[:head.end()]}<default><geom friction="{_UNSAID}"/></default>'
             f'{text[head.end():]}')
    try:
        spec = mujoco.MjSpec.from_string(other, include=_included(path, text))
        found = np.array([geom.friction[0] for geom in spec.geoms])
    except (ValueError, OSError):
        found = np.zeros(0)
    if len(found) != model.ngeom:  # what is attached or replicated is there once alone
        content.notes.append("friction is MuJoCo's, 1 where the file states none: it was not found "
                             'out where it does')
        stated: Floats = np.array(model.geom_friction[:, 0])
        return stated
    return np.where(np.abs(found - _UNSAID) < 1e-12, np.nan, model.geom_friction[:, 0])


def _included(path: Path, text: str) -> dict[str, bytes]:
    """Return the files that an MJCF includes, and that those include, by their names in it."""
    found: dict[str, bytes] = {}
    waiting = [text]
    while waiting:
        for name in re.findall(r'<include\s+file\s*=\s*["\']([^"\']+)["\']', waiting.pop()):
            if name not in found:
                found[name] = (path.parent / name).read_bytes()
                waiting.append(found[name].decode('utf-8', 'replace'))
    return found


class _Geoms:
    """Makes obstacles of the geoms of a model."""

    def __init__(self, path: Path, model: Any, data: Any, frictions: Floats,
                 meshes: Mapping[str, Surface], asked: Asked, content: Content) -> None:
        self._path, self._model, self._data = path, model, data
        self._frictions, self._content = frictions, content
        self._meshes, self._asked = meshes, asked  # the meshes of a URDF, by names of geoms
        collides = (np.array(model.geom_contype) != 0) | (np.array(model.geom_conaffinity) != 0)
        for geoms in (model.pair_geom1, model.pair_geom2):  # what a <pair> lets collide
            collides[geoms] = True
        self._solid = np.flatnonzero(collides)

    def read(self) -> None:
        """Put what is there into the content."""
        hidden = self._model.ngeom - len(self._solid)
        if hidden:
            self._content.notes.append('not read: what collides with nothing (contype and '
                                       f'conaffinity 0), {counted(hidden, "geom")}')
        if not len(self._solid):
            raise InvalidTask(f'{self._path}: expected geoms that collide, it has none')
        holes = self._holes()
        for body in dict.fromkeys(int(self._model.geom_bodyid[k]) for k in self._solid):
            own = [int(k) for k in self._solid if self._model.geom_bodyid[k] == body]
            sheet = self._sheet(body, own, holes.pop(body, []))
            self._content.obstacles += [sheet] if sheet is not None else [
                one for k in own for one in self._obstacles(k, self._name(k, own))]
        for left in holes.values():
            self._content.cutouts += left

    def _name(self, k: int, own: list[int]) -> str:
        """Return how a geom is called: by its own name, or by its body's."""
        named, body = str(self._model.geom(k).name), int(self._model.geom_bodyid[k])
        if named in self._meshes:
            named = named.partition(' ')[2]
        if named or body == 0:
            return named
        of_body = _body(self._model, body)
        return of_body if len(own) == 1 or not of_body else f'{of_body}/{own.index(k)}'

    def _pose(self, kind: str, k: int) -> Pose:
        """Return the pose of a geom, a site or a body (kind '')."""
        kind = f'{kind}_' if kind else ''
        return Pose.from_rotation(getattr(self._data, f'{kind}xpos')[k],
                                  getattr(self._data, f'{kind}xmat')[k].reshape(3, 3))

    def _holes(self) -> dict[int, list[CutOut]]:
        """Return the cut-outs that sites named `cutout...` are, by the number of their body."""
        model, out = self._model, dict[int, list[CutOut]]()
        for k in range(model.nsite):
            name = str(model.site(k).name)
            if not _FRAME.fullmatch(name):
                continue
            kind, size, pose = _KINDS[model.site_type[k]], model.site_size[k], self._pose('site', k)
            if kind == 'cylinder':  # its axis is the normal
                hole = CutOut(Pose.from_rotation(pose.position, pose.rotation[:, [2, 0, 1]]),
                              radius=float(size[0]))
            elif kind == 'box':
                hole = CutOut(pose, width=2 * float(size[1]), height=2 * float(size[2]))
            else:
                raise InvalidTask(f'{self._path}: site {name!r} is a {kind}: expected a cylinder, '
                                  'or a box with its x axis through the hole')
            out.setdefault(int(model.site_bodyid[k]), []).append(hole)
        return out

    def _sheet(self, body: int, own: list[int], holes: list[CutOut]) -> Sheet | None:
        """Return the Sheet that a body is; None if it is another body."""
        model, friction = self._model, float(self._frictions[own[0]])
        name = _body(model, body)
        for k in np.flatnonzero(np.array(model.site_bodyid) == body):
            if str(model.site(int(k)).name) == f'{name}/sheet' and model.nuser_site >= 3:
                thickness, width, height = model.site_user[k][:3].tolist()
                return Sheet(self._pose('site', int(k)), width, height, thickness, tuple(holes),
                             friction, name=name)
        if not holes:
            return None
        one, *more = self._obstacles(own[0], self._name(own[0], own))
        alone = len(own) == 1 and not more
        plate = pierced(one, holes) if alone and isinstance(one, Box) else (
            one if alone and isinstance(one, Sheet) else None)
        if plate is None:
            self._content.cutouts += holes
            self._content.notes.append(
                f'cut-outs of body {name!r} are known as such; its geoms stay as they are, since '
                'they are not one box with holes straight through it')
        return plate

    def _obstacles(self, k: int, name: str) -> list[Obstacle]:
        """Return what a geom is; a mesh may be several solids."""
        model, pose = self._model, self._pose('geom', k)
        kind, size = _KINDS[model.geom_type[k]], np.array(model.geom_size[k])
        friction = float(self._frictions[k])
        of_urdf = self._meshes.get(str(model.geom(k).name))
        if of_urdf is not None:
            return self._solids(name or f'geom {k}', of_urdf, pose, self._asked)
        if kind == 'mesh':
            return self._mesh(k, name, pose, friction)
        if kind not in _MADE:
            raise InvalidTask(f'{self._path}: geom {name or k!r} is a {kind}: expected one of '
                              f'{", ".join(sorted((*_MADE, "mesh")))}; a closed mesh of it would '
                              'be read')
        return [replace(_MADE[kind](pose, size), friction=friction, name=name)]

    def _solids(self, name: str, surface: Surface, at: Pose, asked: Asked) -> list[Obstacle]:
        """Return what triangles are, in the frame of a pose."""
        try:
            return [moved(one, at) for one in solids_of(name, surface, asked,
                                                        self._content.notes)]
        except InvalidTask as error:
            raise InvalidTask(f'{self._path}: {error}') from None

    def _mesh(self, k: int, name: str, pose: Pose, friction: float) -> list[Obstacle]:
        model, number = self._model, int(self._model.geom_dataid[k])
        first, count = int(model.mesh_vertadr[number]), int(model.mesh_vertnum[number])
        vertices = np.array(model.mesh_vert[first:first + count], dtype=float)
        first, count = int(model.mesh_faceadr[number]), int(model.mesh_facenum[number])
        faces = np.array(model.mesh_face[first:first + count], dtype=np.int64)
        # in the frame of its body: MuJoCo turns a mesh to its axes of inertia
        at = self._pose('', int(model.geom_bodyid[k]))
        local = at.inverse().compose(pose)
        vertices = local.position + vertices @ local.rotation.T
        asset, name = str(model.mesh(number).name), name or f'geom {k}'
        if asset.startswith(_MESHES[Hull]):
            return [Hull(vertices, at, friction, name=name)]
        for smooth in (True, False):
            if asset.startswith(_MESHES[Mesh, smooth]):
                return [Mesh(vertices, faces, at, friction, smooth, name=name)]
        # with hulls MuJoCo collides as well
        return self._solids(name, Surface(vertices, faces), at,
                            self._asked._replace(friction=friction, hulls=True))


def _bar(kind: type[Capsule | Cylinder]) -> Callable[[Pose, Floats], Obstacle]:
    def made(pose: Pose, size: Floats) -> Obstacle:
        along = size[1] * pose.rotation[:, 2]
        return kind(pose.position - along, pose.position + along, float(size[0]))
    return made


_MADE: dict[str, Callable[[Pose, Floats], Obstacle]] = {
    'plane': lambda pose, size: Plane(pose.position, pose.rotation[:, 2]),
    'sphere': lambda pose, size: Sphere(pose.position, float(size[0])),
    'capsule': _bar(Capsule), 'cylinder': _bar(Cylinder),
    'ellipsoid': Ellipsoid,
    'box': lambda pose, size: Box(pose, 2 * size)}


# ---- and back --------------------------------------------------------------------------------


def text_of_mjcf(obstacles: Iterable[Obstacle], name: str = 'scene') -> str:
    """Return the text of an MJCF file with obstacles, which `read` reads as they were.

    Meshes are kept in single precision by MuJoCo, which collides with their hulls. A sheet with
    holes is a body of convex pieces, with a site for each hole.
    """
    root = ElementTree.Element('mujoco', model=name)
    ElementTree.SubElement(root, 'size', nuser_site='3')
    assets, world = (ElementTree.SubElement(root, tag) for tag in ('asset', 'worldbody'))
    for one in obstacles:
        friction = {'friction': _row(one.friction)}
        # a body for each, since geoms are numbered by their bodies: so they keep their order
        body = ElementTree.SubElement(world, 'body', {'name': one.name, **(
            _at(one.pose) if isinstance(one, Sheet | Mesh | Hull) else {})})
        if isinstance(one, Sheet):
            _add_sheet(one, friction, assets, body)
            continue
        if isinstance(one, Mesh | Hull):
            kind = _MESHES[Hull] if isinstance(one, Hull) else _MESHES[Mesh, one.smooth]
            _add_mesh(assets, kind + one.name, one.points if isinstance(one, Hull) else
                      one.vertices, None if isinstance(one, Hull) else one.faces)
            geom = {'type': 'mesh', 'mesh': kind + one.name}
        else:
            geom = _GEOMS[type(one)](one)
        ElementTree.SubElement(body, 'geom', {'name': one.name, **geom, **friction})
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding='unicode') + '\n'


def _add_sheet(one: Sheet, friction: dict[str, str], assets: ElementTree.Element,
               body: ElementTree.Element) -> None:
    for k, piece in enumerate(pieces_of(one)):
        _add_mesh(assets, f'{one.name}/piece{k}', piece, None)
        ElementTree.SubElement(body, 'geom', {'type': 'mesh', 'mesh': f'{one.name}/piece{k}',
                                              **friction})
    ElementTree.SubElement(body, 'site', {
        'name': f'{one.name}/sheet', 'user': _row(one.thickness, one.width, one.height)})
    depth = 0.5 * max(one.thickness, 1e-6)
    for k, hole in enumerate(one.cutouts):
        pose = one.pose.inverse().compose(hole.pose)
        if hole.radius is not None:
            said = {'type': 'cylinder', 'size': _row(hole.radius, depth), **_at(
                Pose.from_rotation(pose.position, pose.rotation[:, [1, 2, 0]]))}
        else:
            assert hole.width is not None and hole.height is not None
            said = {'type': 'box', 'size': _row(depth, 0.5 * hole.width, 0.5 * hole.height),
                    **_at(pose)}
        ElementTree.SubElement(body, 'site', {'name': f'{one.name}/cutout{k}', **said})


def _add_mesh(assets: ElementTree.Element, name: str, vertices: Floats,
              faces: Ints | None) -> None:
    more = {} if faces is None else {'face': ' '.join(map(str, faces.ravel()))}
    ElementTree.SubElement(assets, 'mesh', {'name': name, 'vertex': _row(*vertices.ravel()),
                                            **more})


def _row(*numbers: float) -> str:
    return ' '.join(f'{float(number):.{_DIGITS}g}' for number in numbers)


def _at(pose: Pose) -> dict[str, str]:
    return {'pos': _row(*pose.position), 'quat': _row(*np.roll(pose.quaternion, 1))}


def _of_bar(kind: str) -> Callable[[Any], dict[str, str]]:
    def said(one: Capsule | Cylinder) -> dict[str, str]:
        solid = one.solids[0]
        return {'type': kind, 'size': _row(one.radius, 0.5 * solid.size[2]), **_at(solid.pose)}
    return said


def _of_plane(one: Plane) -> dict[str, str]:
    pose = Pose.looking_along(one.point, one.normal)
    return {'type': 'plane', 'size': '0 0 1', **_at(
        Pose.from_rotation(pose.position, pose.rotation[:, [1, 2, 0]]))}


_GEOMS: dict[type, Callable[[Any], dict[str, str]]] = {
    Plane: _of_plane,
    Sphere: lambda one: {'type': 'sphere', 'size': _row(one.radius), 'pos': _row(*one.center)},
    Capsule: _of_bar('capsule'), Cylinder: _of_bar('cylinder'),
    Box: lambda one: {'type': 'box', 'size': _row(*0.5 * one.size), **_at(one.pose)},
    Ellipsoid: lambda one: {'type': 'ellipsoid', 'size': _row(*one.half_axes), **_at(one.pose)}}
