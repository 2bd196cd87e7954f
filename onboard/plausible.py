"""Plausibility check (sanity limits) of a boat's file: unlikely values, and keys that a role never reads.

The limits are wide: what real devices and boats have lies well inside. They say nothing of what is right.
"""

from collections.abc import Iterator
from dataclasses import fields
from typing import Final

from common.boat_config import BoatConfig, PortTable, SensorTable

_BAUDS: Final = (
    1200, 2400, 4800, 9600, 14400, 19200, 28800, 38400, 57600, 76800, 115_200, 128_000, 230_400, 250_000, 256_000,
    460_800, 500_000, 576_000, 921_600, 1_000_000, 2_000_000,
)  # fmt: skip
EVERY_ROLE: Final = frozenset({"id", "port", "role", "model", "talkers", "rate_hz", "latency_ms", "checksum"})
_GYRO: Final = frozenset(
    {"gyro_density_deg", "bias_yaw_rate_deg_s", "bias_yaw_rate_sigma_deg_s", "bias_yaw_rate_walk_deg_s"}
)
READ: Final[dict[str, frozenset[str]]] = {
    "gps": frozenset(
        {"sigma_m", "sigma_dgps_m", "sigma_rtk_m", "sigma_float_m", "error_lasts_s", "week_rollover", "lever_fwd_m",
         "lever_stb_m"}
    ),
    "compass": frozenset(
        {"sigma_deg", "compass_bias_sigma_deg", "compass_bias_lasts_s", "compass_deviation_sigma_deg", "deviation_deg"}
    ),
    "imu": _GYRO
    | {"accel_density", "bias_accel_fwd_m_s2", "bias_accel_stb_m_s2", "bias_accel_sigma_m_s2", "bias_accel_walk_m_s2",
       "tilt_leak_sigma_per_m", "heel_leak_sigma", "trust_tilt", "use"},
    "gyro": _GYRO,
    "ais": frozenset(),
    "radar": frozenset(),
}  # fmt: skip
"""Role -> keys that somebody reads for it, beside those of every role."""

_RADIANS: Final = "is it in radians? the unit is degrees"
_LIKELY: Final[dict[str, tuple[float, float, str]]] = {
    "latency_ms": (1.0, 3000.0, "is it in seconds? the unit is milliseconds"),
    "sigma_m": (0.01, 100.0, "the unit is metres"),
    "sigma_dgps_m": (0.01, 100.0, "the unit is metres"),
    "sigma_rtk_m": (0.001, 1.0, "the unit is metres"),
    "sigma_float_m": (0.01, 10.0, "the unit is metres"),
    "sigma_deg": (0.05, 30.0, _RADIANS),
    "compass_bias_sigma_deg": (0.1, 45.0, _RADIANS),
    "compass_deviation_sigma_deg": (0.1, 45.0, _RADIANS),
    "deviation_deg": (0.05, 60.0, _RADIANS),
    "accel_density": (0.0003, 3.0, "the unit is m/s^2/sqrt(Hz)"),
    "gyro_density_deg": (0.004, 5.0, _RADIANS),
    "bias_accel_fwd_m_s2": (0.0, 2.0, "the unit is m/s^2"),
    "bias_accel_stb_m_s2": (0.0, 2.0, "the unit is m/s^2"),
    "bias_yaw_rate_deg_s": (0.0, 10.0, "the unit is deg/s"),
    "lever_fwd_m": (0.0, 40.0, "the unit is metres"),
    "lever_stb_m": (0.0, 15.0, "the unit is metres"),
}
"""Key -> least and largest likely size, whatever its sign, and a hint; 0 is always likely."""
_PERIOD: Final = "is it a period? the unit is Hz"
_RATES_HZ: Final = {"gps": (0.2, 50.0), "compass": (0.5, 200.0), "imu": (2.0, 1000.0), "gyro": (2.0, 1000.0)}
_ANY: Final = (0.0, 1e9)
_VARIATIONS_DEG: Final = (0.05, 60.0)


def doubts(config: BoatConfig) -> list[str]:
    """A sentence for each value that is unlikely and each key that has no effect."""
    found = [doubt for port in config.port for doubt in _of_port(port)]
    if _is_unlikely(config.boat.variation_deg, *_VARIATIONS_DEG):
        found.append(_sentence("[boat] variation_deg", config.boat.variation_deg, *_VARIATIONS_DEG, _RADIANS))
    return found + [doubt for sensor in config.sensor for doubt in _of_sensor(sensor)]


def _of_port(port: PortTable) -> Iterator[str]:
    if port.baud not in _BAUDS:
        yield f"[[port]] {port.name}.baud = {port.baud} is no usual speed"


def _of_sensor(sensor: SensorTable) -> Iterator[str]:
    where = f"[[sensor]] {sensor.id}"
    for item in fields(sensor):
        value = getattr(sensor, item.name)
        if value == item.default:
            continue
        if item.name not in EVERY_ROLE | READ[sensor.role]:
            yield f"{where}.{item.name} = {value} has no effect: nothing reads it for the role {sensor.role}"
            continue
        low, high, hint = _likely(item.name, sensor.role)
        if isinstance(value, float) and _is_unlikely(value, low, high):
            yield _sentence(f"{where}.{item.name}", value, low, high, hint)


def _likely(key: str, role: str) -> tuple[float, float, str]:
    if key == "rate_hz":
        return (*_RATES_HZ.get(role, _ANY), _PERIOD)
    return _LIKELY.get(key, (*_ANY, ""))


def _is_unlikely(value: float | None, low: float, high: float) -> bool:
    return value is not None and value != 0.0 and not low <= abs(value) <= high


def _sentence(where: str, value: float | None, low: float, high: float, hint: str) -> str:
    return f"{where} = {value:g} is unlikely (usual: {low:g} to {high:g}); {hint}"
