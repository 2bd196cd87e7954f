"""Configuration validation: the board's file is read and checked as a whole, and every fault is reported at once."""

import os
import re
from itertools import combinations
from pathlib import Path
from typing import Final

from common.boat_config import ROLES, BoatConfig, PortTable, SensorTable
from common.errors import SettingsError, WayfixError
from common.settings import read_toml
from onboard.devices import make_driver

_SENSOR_ID = re.compile(rf"({'|'.join(ROLES)})([1-9]\d?)")

# Bytes that one measurement takes on the wire, generously: a GPS epoch with its satellite tables, an ArduIMU line.
_ENDPOINT = re.compile(r"tcp://(?:\*|[\w.-]+|\[[0-9A-Fa-f:.%\w]+\]):(?P<port>\*|[0-9]{1,5})|ipc://.+|inproc://.+")
_TALKER = re.compile("[A-Z0-9]{2}")
_NOMINAL_BYTES = {"gps": 500, "imu": 160, "gyro": 40, "compass": 80, "ais": 4000, "radar": 2000}
WHOLE_RATES_HZ: Final = (1, 2, 4, 5, 8, 10, 16, 20)
"""Frame rates (Hz) whose period is a whole number of microseconds and divides the second."""

_BY_PATH: Final = Path("/dev/serial/by-path")
_MOST_NAMES: Final = 8
_BUDGET_FACTOR = 4
_LEAST_BUDGET_BYTES_S = 2000


def load(path: str | Path) -> BoatConfig:
    """Read and check a board configuration; raises SettingsError with all faults."""
    config = read_toml(path, BoatConfig)
    faults = list(_faults(config))
    if faults:
        raise SettingsError(str(path), faults)
    return config


def byte_budget(port: PortTable, config: BoatConfig) -> int:
    """Bytes a second that are parsed on this port: as configured, else four times what its sensors nominally send."""
    if port.byte_budget_per_s is not None:
        return port.byte_budget_per_s
    nominal = sum(
        _NOMINAL_BYTES[sensor.role] * (sensor.rate_hz or ROLES[sensor.role].nominal_rate_hz)
        for sensor in config.sensor
        if sensor.port == port.name
    )
    return max(_LEAST_BUDGET_BYTES_S, round(_BUDGET_FACTOR * nominal))


def _faults(config: BoatConfig) -> list[str]:
    faults = []
    if not config.port:
        faults.append("[[port]]: none given, at least one serial port is needed")
    if not config.sensor:
        faults.append("[[sensor]]: none given, at least one sensor is needed")
    ports = [port.name for port in config.port]
    paths = [os.path.realpath(port.path) for port in config.port]
    ids = [sensor.id for sensor in config.sensor]
    if config.frames.rate_hz not in WHOLE_RATES_HZ:
        known = ", ".join(f"{rate:g}" for rate in WHOLE_RATES_HZ)
        faults.append(
            f"frames.rate_hz: must be one of {known} (frames begin on whole seconds), got {config.frames.rate_hz:g}"
        )
    if (fault := bind_fault(config.link.bind)) is not None:
        faults.append(f"link.bind: {fault}")
    faults += [f"[[port]] {name}: name given twice" for name in _repeated(ports)]
    faults += [_twice(path, [port.path for port in config.port]) for path in _repeated(paths)]
    faults += [f"[[sensor]] {name}: id given twice" for name in _repeated(ids)]
    for sensor in config.sensor:
        faults += _sensor_faults(sensor, ports)
    for first, second in combinations(config.sensor, 2):
        same = (first.port, first.role) == (second.port, second.role)
        apart = first.talkers and second.talkers and not set(first.talkers) & set(second.talkers)
        if same and not apart:
            where = f"[[sensor]] {second.id}.talkers"
            faults.append(f"{where}: {first.id} on the same port takes the same lines, give both different talkers")
    return faults


def _sensor_faults(sensor: SensorTable, ports: list[str]) -> list[str]:
    faults = []
    where = f"[[sensor]] {sensor.id}"
    match = _SENSOR_ID.fullmatch(sensor.id)
    if match is None:
        faults.append(f"{where}.id: must be a role and a number, like {sensor.role}1")
    elif match[1] != sensor.role:
        faults.append(f"{where}.role: {sensor.role} does not fit the id, which says {match[1]}")
    faults += [
        f"{where}.talkers: must be two capital letters or digits like GP, got {talker!r}"
        for talker in sensor.talkers
        if not _TALKER.fullmatch(talker)
    ]
    if sensor.port not in ports:
        faults.append(f"{where}.port: no [[port]] is named {sensor.port} (known: {', '.join(ports) or 'none'})")
    try:
        make_driver(sensor)
    except WayfixError as error:
        faults.append(f"{where}.model: {error.what} ({error.cure})")
    return faults


def bind_fault(endpoint: str) -> str | None:
    """Why the daemon cannot listen there, or None."""
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None:
        return f"must be tcp://ADDRESS:PORT (* = all), got {endpoint}"
    port = match["port"] or "*"
    return None if port == "*" or int(port) < 2**16 else f"there is no port above 65535, got {endpoint}"


def _twice(path: str, given: list[str], by_path: Path = _BY_PATH) -> str:
    """One device given for two ports: by mistake, or because two adapters alike have one by-id name between them."""
    fault = f"[[port]]: path {path} given twice, put its sensors on one port"
    names = sorted(map(str, by_path.glob("*")))
    if not names or not any("/by-id/" in name for name in given if os.path.realpath(name) == path):
        return fault
    return f"{fault}; if these are two adapters alike, give each by its by-path name: {', '.join(names[:_MOST_NAMES])}"


def _repeated(names: list[str]) -> list[str]:
    return sorted({name for name in names if names.count(name) > 1})
