"""Driver registry: which driver serves a sensor, one table by role and model."""

from collections.abc import Callable
from typing import Final

from common.boat_config import SensorTable
from common.errors import WayfixError
from onboard.devices.compass.driver import CompassDriver, hmr3000, hsc100
from onboard.devices.compass.kvh import KvhDriver
from onboard.devices.compass.tcm2 import Tcm2Driver
from onboard.devices.driver import Driver
from onboard.devices.gps.driver import GpsDriver
from onboard.devices.inertial.arduimu import ArduImuDriver
from onboard.devices.inertial.tinkerkit import TinkerKitDriver
from onboard.devices.traffic.ais import AisDriver
from onboard.devices.traffic.radar import RadarDriver

MODELS: Final[dict[tuple[str, str], Callable[[SensorTable], Driver]]] = {
    ("gps", "nmea"): GpsDriver,
    ("compass", "nmea"): CompassDriver,
    ("compass", "hsc100"): hsc100,
    ("compass", "tcm2"): Tcm2Driver,
    ("compass", "hmr3000"): hmr3000,
    ("compass", "kvh-c100"): KvhDriver,
    ("imu", "arduimu"): ArduImuDriver,
    ("gyro", "tinkerkit"): TinkerKitDriver,
    ("ais", "nmea"): AisDriver,
    ("radar", "nmea"): RadarDriver,
}


def make_driver(table: SensorTable) -> Driver:
    """The driver of one `[[sensor]]`.

    Raises WayfixError where the role has no such model; it names the models there are.
    """
    maker = MODELS.get((table.role, table.model))
    if maker is not None:
        return maker(table)
    models = [f'"{model}"' for role, model in MODELS if role == table.role]
    raise WayfixError(
        f'no driver for role "{table.role}" with model "{table.model}"',
        where=f"[[sensor]] {table.id}.model",
        cure=f"known: {', '.join(models)}",
    )
