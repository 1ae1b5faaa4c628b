# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Values as plain Python: what JSON, YAML and pandas understand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum

import numpy as np

from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, parts_of


def plain(content: object) -> object:
    """Return a content as dicts, lists, numbers, strings, truth values and None.

    A Value becomes the dict of its public attributes, but for opaque ones, a Pose {'position',
    'quaternion'}, an array nested lists, an Enum its value. What is none of these (a function)
    becomes its repr.
    """
    if isinstance(content, Enum):
        return content.value
    if isinstance(content, np.ndarray | np.generic):
        return content.tolist()
    if isinstance(content, Pose):
        return {'position': content.position.tolist(), 'quaternion': content.quaternion.tolist()}
    if isinstance(content, Value):
        names = ([item.name for item in fields(content) if not item.metadata.get('opaque')]
                 if is_dataclass(content) else parts_of(content))
        return {name: plain(getattr(content, name)) for name in names if not name.startswith('_')}
    if isinstance(content, Mapping):
        return {str(key): plain(part) for key, part in content.items()}
    if isinstance(content, tuple | list):
        return [plain(part) for part in content]
    if content is None or isinstance(content, bool | int | float | str):
        return content
    return repr(content)
