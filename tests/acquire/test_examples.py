"""The example configurations: the whole boat of the thesis, and no model that no example shows."""

from pathlib import Path

import pytest

from common.boat_config import stale_after_s
from onboard.config import load
from onboard.devices.registry import MODELS

EXAMPLES = Path(__file__).parents[2] / "deploy" / "examples"
SPRINGER = EXAMPLES / "springer.toml"


def test_springer_follows_the_tables_of_the_thesis() -> None:
    """Tables 3.1 (baud, rate, accuracy of the compasses), 3.2, 3.4 and section 3.2.2."""
    config = load(SPRINGER)
    bauds = {port.name: port.baud for port in config.port}
    found = {sensor.id: (sensor.model, bauds[sensor.port], sensor.rate_hz) for sensor in config.sensor}
    assert found == {
        "gps1": ("nmea", 4800, 1),
        "imu1": ("arduimu", 38400, 20),
        "gyro1": ("tinkerkit", 38400, 20),
        "compass1": ("hsc100", 4800, 10),
        "compass2": ("tcm2", 38400, 10),
        "compass3": ("hmr3000", 19200, 20),
        "compass4": ("kvh-c100", 9600, 1),
        "ais1": ("nmea", 38400, None),
        "radar1": ("nmea", 38400, None),
    }
    assert [sensor.sigma_deg for sensor in config.with_role("compass")] == [0.5, 1.0, 0.5, 0.5]
    (imu,) = config.with_role("imu")
    assert (imu.bias_accel_fwd_m_s2, imu.bias_accel_stb_m_s2, imu.bias_yaw_rate_deg_s) == (0.03, 0.02, 0.28)


@pytest.mark.parametrize(
    ("role", "rate_hz", "stale_s"), [("imu", 8.33, 3.0), ("imu", 50, 3.0), ("compass", 20, 3.0), ("compass", 1, 5.0)]
)
def test_stale_after_comes_from_the_configured_rate(role: str, rate_hz: float, stale_s: float) -> None:
    assert stale_after_s(role, rate_hz) == stale_s


def test_every_model_is_in_an_example() -> None:
    shown = {(s.role, s.model) for name in ("boat", "springer") for s in load(EXAMPLES / f"{name}.toml").sensor}
    assert shown == set(MODELS)


def test_boat_toml_names_every_model() -> None:
    text = (EXAMPLES / "boat.toml").read_text(encoding="utf-8")
    assert all(model in text for _, model in MODELS)
