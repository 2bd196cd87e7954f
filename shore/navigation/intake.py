"""Frames in, batches for a bank of filters out, on one local tangent plane; and when that plane is the wrong one."""

from collections.abc import Callable
from typing import Final

from common.boat_config import BoatConfig
from common.geodesy import LocalPlane
from common.messages import Event, Frame
from shore.navigation.filter_bank import Batch
from shore.navigation.imu_track import ImuTrack, blocks_of, driving_sensor
from shore.navigation.measurements import Reader

FAR_FIXES: Final = 10
"""Number of fixes in a row beyond the plane's reach that mean a wrong origin (or a boat that was carried away)."""


class Intake:
    """Converts the frames of one clock of the board on one plane; when that is wrong, another intake is to be made."""

    def __init__(self, config: BoatConfig, tell: Callable[[Event], None]) -> None:
        self._driver = driving_sensor(config)
        self.imu: Final = ImuTrack(self._driver) if self._driver else None
        """The IMU that the filters use, `None` = there is none."""
        self._reader = Reader(config, tell)

    @property
    def plane(self) -> LocalPlane | None:
        """The local plane, `None` before the first usable fix."""
        return self._reader.plane

    @property
    def is_out_of_reach(self) -> bool:
        """True once `FAR_FIXES` fixes in a row lie beyond the plane: everything begins again on another one."""
        return self._reader.far_in_a_row >= FAR_FIXES

    @property
    def implausible(self) -> dict[str, int]:
        """Sensor -> samples of the IMU that were no plausible numbers, left out so far."""
        return {self._driver.id: self.imu.left_out} if self._driver and self.imu else {}

    def batch(self, frame: Frame) -> Batch:
        """The frame's measurements, converted; those of no use are left out."""
        blocks = blocks_of(frame, self._driver) if self._driver else ()
        return Batch(frame.t1_ns, frame.boot_id, self._reader.read(frame), blocks)
