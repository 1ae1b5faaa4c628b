# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is read from a robot's URDF and SRDF text itself, apart from any kinematics library."""

from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, shown

_PACKAGE, _FILE = 'package://', 'file://'


def parsed(name: str, text: str) -> ElementTree.Element:
    """Return the <robot> element of an XML text.

    Parameters
    ----------
    name : str
        How the caller knows the text; it stands in messages.

    Raises
    ------
    InvalidTask
        No XML, or not of a robot.
    """
    instance(name, text, str)
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InvalidTask(f'{name} = {shown(text)}: expected XML; {error}') from None
    if root.tag != 'robot':
        raise InvalidTask(f'{name} has the element <{root.tag}>: expected <robot>')
    return root


def single_joints(root: ElementTree.Element) -> set[str]:
    """Return the names of the joints with one coordinate."""
    return {joint.get('name', '') for joint in root.findall('joint')
            if joint.get('type') in ('revolute', 'continuous', 'prismatic')}


def mimics(root: ElementTree.Element) -> dict[str, tuple[str, float, float]]:
    """Return for each joint that follows another: its leader, multiplier and offset."""
    found = {}
    for joint in root.findall('joint'):
        mimic = joint.find('mimic')
        if mimic is not None:
            found[joint.get('name', '')] = (
                mimic.get('joint', ''), float(mimic.get('multiplier', 1)),
                float(mimic.get('offset', 0)))
    return found


def resolve_meshes(root: ElementTree.Element, packages: Sequence[str]) -> list[str]:
    """Make the paths of collision meshes absolute; take those out that are not there.

    `package://name/rest` is looked for as `folder/name/rest`, and as `folder/rest` where the folder
    itself has that name.
    """
    missing = []
    for link in root.findall('link'):
        for visual in link.findall('visual'):
            link.remove(visual)
        for collision in link.findall('collision'):
            mesh = collision.find('geometry/mesh')
            if mesh is None:
                continue
            path = _path_of(mesh.get('filename', ''), packages)
            if path is None:
                link.remove(collision)
                missing.append(f'{link.get("name")} ({mesh.get("filename")})')
            else:
                mesh.set('filename', str(path))
    return missing


def _path_of(filename: str, packages: Sequence[str]) -> Path | None:
    """Return the Path of a mesh, or None if it is not there."""
    if filename.startswith(_PACKAGE):
        package, _, rest = filename[len(_PACKAGE):].partition('/')
        places = list(chain.from_iterable(
            (Path(folder) / package / rest,
             *([Path(folder) / rest] if Path(folder).name == package else []))
            for folder in packages))
    else:
        places = [Path(filename.removeprefix(_FILE))]
    return next((place.absolute() for place in places if place.is_file()), None)


def disabled_pairs(srdf: str) -> set[frozenset[str]]:
    """Return the pairs of links that an SRDF says need not be looked at."""
    return {frozenset((pair.get('link1', ''), pair.get('link2', '')))
            for pair in parsed('srdf', srdf).iter('disable_collisions')}
