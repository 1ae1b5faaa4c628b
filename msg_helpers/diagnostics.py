"""Named values -> diagnostic_msgs."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def diagnostics_msg(name, hardware_id, level, message, values, stamp):
    """Return a DiagnosticArray with one status.

    Args:
        name: of the status, 'node: topic'
        hardware_id: of what it speaks
        level: OK, WARN or ERROR of this module (bytes, as the message wants them)
        message: one line for people
        values: dict of str -> anything; numbers are written with six digits
        stamp: builtin_interfaces/Time
    """
    status = DiagnosticStatus(name=name, hardware_id=hardware_id, level=level, message=message)
    status.values = [KeyValue(key=key, value=_text(value)) for key, value in values.items()]
    array = DiagnosticArray(status=[status])
    array.header.stamp = stamp
    return array


def _text(value):
    return f'{value:.6g}' if isinstance(value, float) else str(value)
