"""Configuration check (`wayfix-onboard check`): the file, its ports, and what comes on them."""

import argparse
import asyncio
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from common.command import number
from common.errors import WayfixError
from common.words import counted

if TYPE_CHECKING:
    from onboard.reading.trial import PortHeard, SensorHeard

_SILENT = "nothing came; that is no fault of an AIS receiver or a radar"


def add_arguments(commands: Any) -> None:
    """Add the sub-parser."""
    parser = commands.add_parser(
        "check", help="check a configuration, its ports and sensors", description=_check.__doc__
    )
    parser.add_argument("config")
    parser.add_argument(
        "--listen",
        type=number(float, 0.0, 3600.0),
        default=5.0,
        metavar="S",
        help="seconds for which the ports are read (default 5); 0 = they are only opened",
    )
    parser.set_defaults(command=_check)


def _check(arguments: argparse.Namespace) -> int:
    """Check a configuration file, open every port and listen to it.

    Exit code 1: a sensor does not deliver; 2: the file is wrong, or a port does not open.
    """
    from onboard.config import load
    from onboard.plausible import doubts
    from onboard.reading.trial import heard

    config = load(arguments.config)
    counts = f"{counted(len(config.port), 'port')}, {counted(len(config.sensor), 'sensor')}"
    _tell(f"{arguments.config}: boat {config.boat.id}, {counts}")
    for doubt in doubts(config):
        _tell(f"  doubtful: {doubt}")
    if arguments.listen:
        sys.stderr.write(f"listening for {arguments.listen:g} s\n")
    found = asyncio.run(heard(config, arguments.listen))
    for port in found:
        for line in _words(port, arguments.listen):
            _tell(line)
    _refuse_closed(found, str(arguments.config))
    silent = [sensor.table.id for port in found for sensor in port.sensors if sensor.why]
    if not arguments.listen or not silent:
        return 0
    sys.stderr.write(f"{len(silent)} of {counted(len(config.sensor), 'sensor')} do not deliver: {', '.join(silent)}\n")
    return 1


def _refuse_closed(found: "list[PortHeard]", file: str) -> None:
    closed = [port for port in found if port.fault is not None]
    if not closed:
        return
    first = closed[0]
    what = f"{first.table.name} ({first.table.path}): {first.fault}"
    if len(closed) > 1:
        what = f"{what}; and {counted(len(closed) - 1, 'more port')}, see above"
    raise WayfixError(what, file, _cure(what))


def _cure(what: str) -> str:
    if "wayfix-onboard (pid" in what:
        return (
            "the running daemon has it: `wayfix-onboard status` says how its sensors are, `raw SENSOR` shows the lines"
        )
    return "check the path, the plug and who else uses the port"


def _words(port: "PortHeard", seconds: float) -> Iterator[str]:
    """What was found on one port, for people."""
    head = f"{port.table.name} ({port.table.path}, {port.table.baud} baud)"
    if port.fault is not None:
        yield f"{head}: {port.fault}"
        return
    holders = f"; {' and '.join(map(str, port.holders))} has it open too" if port.holders else ""
    if not seconds:
        yield f"{head}: opens; {port.owner}{holders}"
        return
    came = f"{port.size} bytes, {port.size / seconds:.0f} a second, {port.readable:.0%} readable"
    yield f"{head}: {came if port.size else 'nothing came'}; {port.owner}{holders}"
    for sensor in port.sensors:
        yield f"  {_sentence(sensor)}"
    if port.unread:
        yield f"  not read: {', '.join(port.unread[:12])}"
    for sample in port.samples:
        yield f"  | {sample}"


def _sentence(sensor: "SensorHeard") -> str:
    if sensor.delivers:
        kinds = ", ".join(f"{kind} {count}" for kind, count in sensor.kinds.items())
        return f"{sensor.table.id} delivers, {sensor.rate_hz:.3g} a second ({kinds})"
    return f"{sensor.table.id} does not deliver: {sensor.why}" if sensor.why else f"{sensor.table.id}: {_SILENT}"


def _tell(line: str) -> None:
    sys.stdout.write(f"{line}\n")
