"""Which driver serves a sensor: one table by role and model."""

from collections.abc import Callable
from typing import Final

from common.errors import WayfixError
from common.sensors import SensorTable
from onboard.devices.base import Driver
from onboard.devices.compass.driver import CompassDriver
from onboard.devices.gps.driver import GpsDriver
from onboard.devices.inertial.arduimu import ArduImuDriver

MODELS: Final[dict[tuple[str, str], Callable[[SensorTable], Driver]]] = {
    ("gps", "nmea"): GpsDriver,
    ("compass", "nmea"): CompassDriver,
    ("imu", "arduimu"): ArduImuDriver,
}


def make_driver(table: SensorTable) -> Driver:
    """The driver of one `[[sensor]]`.

    Raises WayfixError where the role has no such model; it names the models there are.
    """
    maker = MODELS.get((table.role, table.model))
    if maker is not None:
        return maker(table)
    models = [f'"{model}"' for role, model in MODELS if role == table.role]
    everything = [f"{role} {model}" for role, model in MODELS]
    raise WayfixError(
        f'no driver for role "{table.role}" with model "{table.model}"',
        where=f"[[sensor]] {table.id}.model",
        cure=f"known: {', '.join(models or everything)}",
    )
