"""Port monitor (`wayfix-onboard listen`): the lines of one serial port as they come, without any configuration."""

import argparse
import select
import sys
from collections.abc import Iterator
from typing import Any, Final

from common.boat_config import PortTable, SensorTable
from common.command import number
from common.errors import WayfixError
from common.visible_lines import VisibleLines

_PAUSE_S: Final = 0.3
"""A line that has not ended after so long is shown as it is, s."""
_VERDICT_BYTES: Final = 300


def add_arguments(commands: Any) -> None:
    """Add the sub-parser."""
    parser = commands.add_parser("listen", help="show what comes on a serial port", description=_listen.__doc__)
    parser.add_argument("port", metavar="PORT", help="its path, like /dev/ttyUSB0")
    parser.add_argument("--baud", type=number(int, 300, 4_000_000), default=4800, metavar="N", help="default 4800")
    parser.set_defaults(command=_listen)


def _listen(arguments: argparse.Namespace) -> int:
    """Show the lines of a serial port as they come, control characters made visible, until Ctrl-C.

    What is no text is shown in hexadecimal. As soon as it is known what comes, a line on stderr says so.
    """
    from onboard.reading.recent_bytes import RecentBytes

    recent, lines, is_named = RecentBytes(), VisibleLines(_tell), False
    for data in _chunks(PortTable(name="port", path=arguments.port, baud=arguments.baud)):
        recent.add(data)
        lines.feed(data)
        sys.stdout.flush()
        if not is_named and len(recent.newest()) >= _VERDICT_BYTES and (words := _verdict(recent.newest())) is not None:
            sys.stderr.write(f"{words}\n")
            is_named = True
    raise WayfixError("the device is gone", arguments.port, "check plug and power")


def _tell(line: str) -> None:
    sys.stdout.write(f"{line}\n")


def _chunks(table: PortTable) -> Iterator[bytes]:
    """What the port brings; empty after a pause, ends when the device is gone. Raises WayfixError."""
    from onboard.reading.ports import OPEN_ERRORS, open_serial, read_serial, reason_at, reason_of

    try:
        device = open_serial(table)
    except OPEN_ERRORS as error:
        raise WayfixError(reason_at(table.path, error), table.path) from error
    try:
        while (data := read_serial(device) if select.select([device], [], [], _PAUSE_S)[0] else b"") is not None:
            yield data
    except OSError as error:
        raise WayfixError(reason_of(error), table.path, "check plug and power") from error
    finally:
        device.close()


def _verdict(data: bytes) -> str | None:
    """What comes, in words; `None` = not known yet."""
    from onboard.devices import Line
    from onboard.devices.recognise import NOISE, WANTED, recognised_by_role, stranger

    lines = [Line(0, line) for line in data.replace(b"\r", b"\n").split(b"\n")[1:-1] if line]
    found = recognised_by_role(lines)
    if found:
        return f"read as {' and '.join(f'{role} {model}' for role, model in found.items())}"
    other = stranger(SensorTable(id="gps1", port="p", role="gps"), data, lines)
    if other is None:
        return None
    if other is NOISE:
        return f"{len(data)} bytes came, {NOISE}"
    return other.what if other.cure in WANTED.values() else str(other)
