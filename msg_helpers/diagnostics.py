# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Named values -> diagnostic_msgs."""

from __future__ import annotations

from collections.abc import Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, items

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
_LEVELS = (OK, WARN, ERROR, DiagnosticStatus.STALE)


def status_msg(name: str, hardware_id: str, level: bytes, message: str,
               values: Mapping[str, object]) -> DiagnosticStatus:
    """Return a DiagnosticStatus."""
    for argument, value in (('name', name), ('hardware_id', hardware_id), ('message', message)):
        instance(argument, value, str)
    instance('level', level, bytes)
    if level not in _LEVELS:
        raise InvalidTask(f'level = {level!r}: expected OK, WARN, ERROR or STALE')
    instance('values', values, dict)
    items('values', tuple(values), str)
    status = DiagnosticStatus(name=name, hardware_id=hardware_id, level=level, message=message)
    status.values = [KeyValue(key=key, value=_text(value)) for key, value in values.items()]
    return status


def diagnostics_msg(name: str, hardware_id: str, level: bytes, message: str,
                    values: Mapping[str, object], stamp: Time) -> DiagnosticArray:
    """Return a DiagnosticArray with one status."""
    status = status_msg(name, hardware_id, level, message, values)
    array = DiagnosticArray(status=[status])
    array.header.stamp = instance('stamp', stamp, Time)
    return array


def _text(value: object) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
