# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tasks as YAML files."""

from pathlib import Path
from typing import Any

from dlo_planner.files import text_of, writable
from dlo_planner.inverse.task import Task
from dlo_planner.model.checks import instance
from dlo_planner.settings.guarded_yaml import load_yaml, yaml_of


def task_to_yaml(task: Task) -> str:
    """Return a task as a YAML text: its class under `type`, each value in it likewise.

    Raises
    ------
    InvalidTask
        It is not a task, or holds a function, which cannot be written.
    """
    return yaml_of(instance('task', task, Task).to_dict())


def task_from_yaml(text: str, name: str = 'task') -> Task:
    """Return the task of a YAML text.

    Parameters
    ----------
    text : str
        As `task_to_yaml` writes it; what has a default may be left out.
    name : str, optional
        Its name in messages.

    Raises
    ------
    InvalidTask
        It is not YAML, or not a task.
    """
    content: Any = load_yaml(instance('text', text, str), name)
    return Task.from_dict(content)


def read_task(path: Path) -> Task:
    """Return the task of a YAML file; raises InvalidTask as `task_from_yaml` does."""
    return task_from_yaml(text_of(path), str(path))


def write_task(path: Path, task: Task) -> None:
    """Write a task as a YAML file."""
    writable(path).write_text(task_to_yaml(task), encoding='utf-8')
