"""Registry of device models: driver and encoder of each, one table by role and model."""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

from common.boat_config import SensorTable
from common.errors import WayfixError
from onboard.devices.compass.driver import CompassDriver, hmr3000, hsc100
from onboard.devices.compass.encoder import CompassEncoder, Hmr3000Encoder, Hsc100Encoder
from onboard.devices.compass.kvh import KvhDriver, KvhEncoder
from onboard.devices.compass.tcm2 import Tcm2Driver, Tcm2Encoder
from onboard.devices.driver import Driver
from onboard.devices.encoder import Encoder, Surroundings
from onboard.devices.gps.driver import GpsDriver
from onboard.devices.gps.encoder import GpsEncoder
from onboard.devices.inertial.arduimu import ArduImuDriver, ArduImuEncoder
from onboard.devices.inertial.tinkerkit import TinkerKitDriver, TinkerKitEncoder
from onboard.devices.optional_checksum import OptionalChecksum
from onboard.devices.traffic.ais import AisDriver, AisEncoder
from onboard.devices.traffic.radar import RadarDriver, RadarEncoder


class Model(NamedTuple):
    """How a model is read, and how it is simulated."""

    driver: Callable[[SensorTable], Driver]
    encoder: Callable[[SensorTable, Surroundings], Encoder[Any]]


MODELS: Final[dict[tuple[str, str], Model]] = {
    ("gps", "nmea"): Model(GpsDriver, GpsEncoder),
    ("compass", "nmea"): Model(CompassDriver, CompassEncoder),
    ("compass", "hsc100"): Model(hsc100, Hsc100Encoder),
    ("compass", "tcm2"): Model(Tcm2Driver, Tcm2Encoder),
    ("compass", "hmr3000"): Model(hmr3000, Hmr3000Encoder),
    ("compass", "kvh-c100"): Model(KvhDriver, KvhEncoder),
    ("imu", "arduimu"): Model(ArduImuDriver, ArduImuEncoder),
    ("gyro", "tinkerkit"): Model(TinkerKitDriver, TinkerKitEncoder),
    ("ais", "nmea"): Model(AisDriver, AisEncoder),
    ("radar", "nmea"): Model(RadarDriver, RadarEncoder),
}


def make_driver(table: SensorTable) -> Driver:
    """The driver of one `[[sensor]]`; raises WayfixError as `_model` does."""
    driver = _model(table).driver(table)
    return OptionalChecksum(driver) if table.checksum == "optional" else driver


def make_encoder(table: SensorTable, around: Surroundings) -> Encoder[Any]:
    """The encoder of one `[[sensor]]`; it takes readings of its role. Raises WayfixError as `_model` does."""
    return _model(table).encoder(table, around)


def _model(table: SensorTable) -> Model:
    """The model of a table; raises WayfixError where the role has no such model, and names the models there are."""
    model = MODELS.get((table.role, table.model))
    if model is not None:
        return model
    models = [f'"{model}"' for role, model in MODELS if role == table.role]
    raise WayfixError(
        f'no driver for role "{table.role}" with model "{table.model}"',
        where=f"[[sensor]] {table.id}.model",
        cure=f"known: {', '.join(models)}",
    )
