"""Without ports: a reading becomes what encoder and driver make of it, value for value, for every model."""

import random
from dataclasses import asdict
from typing import Any

import pytest

from common.boat_config import SensorTable
from common.framer import Measurement
from common.messages import Fix
from common.simulation.measured import Measured
from common.simulation.readings import FixReading
from common.units import NS_PER_S
from onboard.devices.driver import COMPANIONS
from tests.simulate.test_encoders_read_back import AROUND, DRAWN, read_back

COUNT = 400
CONSTANT = ("alt_m", "pdop", "vdop", "fix_mode", "yaw_deg")
"""Fields that a device prints but no filter uses."""
PLACE = ("lat_deg", "lon_deg")


def shown(measurement: Measurement) -> dict[str, Any]:
    fields = {"kind": type(measurement).__name__, **asdict(measurement)}
    return {name: value for name, value in fields.items() if value is not None and name not in CONSTANT}


@pytest.mark.parametrize(("role", "model"), DRAWN)
def test_a_reading_becomes_what_its_device_prints(role: str, model: str) -> None:
    draw = random.Random(f"measured {role} {model}")
    readings = [DRAWN[role, model](draw)[0] for _ in range(COUNT)]
    table = SensorTable(id=f"{role}1", port="p", role=role, model=model)
    measured = Measured(table, AROUND.variation_deg, AROUND.utc_start_ns)
    for t_s, (reading, found) in enumerate(zip(readings, read_back(table, iter(readings), 1.0), strict=True)):
        t_ns = t_s * NS_PER_S
        made = [item for item in measured.measurements(t_s, t_ns, reading) if not isinstance(item, COMPANIONS)]
        assert len(made) == len(found), (reading, made, found)
        for ours, theirs in zip(map(shown, made), map(shown, found), strict=True):
            assert ours == pytest.approx(theirs, abs=1e-9), reading
            # What was sent is looked for in the log, so places are equal to the last bit.
            assert [ours.get(name) for name in PLACE] == [theirs.get(name) for name in PLACE]


def test_a_late_fix_has_its_own_utc() -> None:
    """A latency that the boat's file does not know moves the stamp, not the receiver's time."""
    table = SensorTable(id="gps1", port="p", role="gps", model="nmea")
    measured = Measured(table, 0.0, AROUND.utc_start_ns)
    tod_ms = []
    for late_s in (0.0, 0.5):
        fix = next(measured.measurements(5.0, 5 * NS_PER_S, FixReading(50.0, 1.0, late_s=late_s)))
        assert isinstance(fix, Fix)
        tod_ms.append(fix.tod_ms)
    assert tod_ms == [4_000, 3_500]
