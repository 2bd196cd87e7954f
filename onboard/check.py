"""Configuration check (`wayfix-onboard check`): whether a configuration is right, and every port opens."""

import argparse
import sys
from typing import Any

from common.errors import WayfixError
from common.words import counted


def add_arguments(commands: Any) -> None:
    """Add the sub-parser."""
    parser = commands.add_parser("check", help="check a configuration and its ports", description=_check.__doc__)
    parser.add_argument("config")
    parser.set_defaults(command=_check)


def _check(arguments: argparse.Namespace) -> int:
    """Check a configuration file and try every port; exit code 2 when something is wrong."""
    from onboard.config import load
    from onboard.reading.ports import OPEN_ERRORS, open_serial, reason_of

    config = load(arguments.config)
    counts = f"{counted(len(config.port), 'port')}, {counted(len(config.sensor), 'sensor')}"
    sys.stdout.write(f"{arguments.config}: boat {config.boat.id}, {counts}\n")
    faults = []
    width = max(len(port.path) for port in config.port)
    for port in config.port:
        sensors = ", ".join(sensor.id for sensor in config.sensor if sensor.port == port.name) or "no sensor"
        try:
            open_serial(port).close()
            state = "opens"
        except OPEN_ERRORS as error:
            state = reason_of(error)
            faults.append(f"{port.name} ({port.path}): {state}")
        sys.stdout.write(f"  {port.name:12} {port.path:{width}} {port.baud:>7} baud  {sensors}: {state}\n")
    if faults:
        cure = "check the path, the plug and who else uses the port"
        raise WayfixError("; ".join(faults), str(arguments.config), cure)
    return 0
