"""Helpers of the acquisition tests: checksums, lines, sensors, and the recordings beside the repository."""

from functools import reduce
from operator import xor

import pytest

from common.boat_config import SensorTable
from common.framer import Measurement
from common.messages import ClockPair, Fix, Heading
from onboard.devices import Accepted, Line, Outcome
from tests.recordings import SHARED_DATA as DATA

MS = 1_000_000
S = 1000 * MS

GGA = b"$GPGGA,030719.000,3747.0873,S,17518.8938,E,1,08,1.1,59.9,M,23.7,M,,0000*7D"
GSA = b"$GPGSA,A,3,17,28,06,01,30,20,26,13,,,,,1.8,1.1,1.5*33"
RMC = b"$GPRMC,030719.000,A,3747.0873,S,17518.8938,E,0.69,181.39,311214,,,A*7D"
ARDUIMU = b"!!!VER:1.9,RLL:-15.81,PCH:-47.43,YAW:109.61,IMUH:253,TOW:0***"


def sealed(body: str) -> bytes:
    """`GPGGA,...` -> `$GPGGA,...*hh`."""
    data = body.encode("latin-1")
    return b"$" + data + b"*%02X" % reduce(xor, data, 0)


def line(data: bytes, t_ns: int = 0) -> Line:
    return Line(t_ns, data)


def gps(**changes: object) -> SensorTable:
    return SensorTable(**{"id": "gps1", "port": "p", "role": "gps", **changes})  # type: ignore[arg-type]


def compass(**changes: object) -> SensorTable:
    return SensorTable(**{"id": "compass1", "port": "p", "role": "compass", **changes})  # type: ignore[arg-type]


def imu(**changes: object) -> SensorTable:
    table = {"id": "imu1", "port": "p", "role": "imu", "model": "arduimu", **changes}
    return SensorTable(**table)  # type: ignore[arg-type]


def measured(outcome: Outcome) -> tuple[Measurement, ...]:
    assert isinstance(outcome, Accepted), outcome
    return outcome.measurements


def fixes(measurements: tuple[Measurement, ...]) -> list[Fix]:
    return [m for m in measurements if isinstance(m, Fix)]


def pairs(measurements: tuple[Measurement, ...]) -> list[ClockPair]:
    return [m for m in measurements if isinstance(m, ClockPair)]


def heading(outcome: Outcome) -> Heading:
    (found,) = measured(outcome)
    assert isinstance(found, Heading)
    return found


def recording(name: str) -> bytes:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"the recording {name} is not beside the repository ({DATA})")
    return path.read_bytes()
