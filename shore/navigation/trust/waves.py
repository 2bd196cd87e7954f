"""Attitude in waves (gravity leakage): how wrong the gyro of a rolling and pitching hull can be."""

import math
from typing import Final, NamedTuple

from common.units import STANDARD_GRAVITY_M_S2
from shore.navigation.motion_model import ImuInput

WAVES_RAD_S: Final = 2.0 * math.pi * 0.4
"""Angular frequency of the waves that move a small hull, rad/s."""
LARGEST_TILT_RAD: Final = 0.35
"""Waves are not taken for larger than this: a scale factor may be wrong."""
QUICK_S, SLOW_S, MEMORY_S = 0.3, 20.0, 30.0
"""Time constants: vibration is gone and waves are left; manoeuvres are gone; memory of the mean square."""


class Waves(NamedTuple):
    """What the accelerometers show of the waves: gravity leaks into both axes; immutable."""

    quick: tuple[float, float] = (0.0, 0.0)
    """Forward and starboard acceleration without the vibration of an engine, m/s^2."""
    slow: tuple[float, float] = (0.0, 0.0)
    """The same as its mean over some waves, m/s^2."""
    square: tuple[float, float] = (0.0, 0.0)
    """Fading mean square of the difference of both, m^2/s^4."""

    @property
    def gyro_rad_s(self) -> float:
        """1-sigma of what a gyro shows of pitching while the hull rolls, rad/s: its axis is not the vertical then.

        It is pitch rate x roll (Euler's kinematic equations), and both may be in step for a while.
        """
        pitch, roll = (min(math.sqrt(each) / STANDARD_GRAVITY_M_S2, LARGEST_TILT_RAD) for each in self.square)
        return WAVES_RAD_S * pitch * roll

    def then(self, dt_s: float, imu: ImuInput) -> "Waves":
        """What is known after one more sample that covers `dt_s`."""
        to_quick, to_slow, to_square = (dt_s / (time_s + dt_s) for time_s in (QUICK_S, SLOW_S, MEMORY_S))
        axes = []
        for shown, quick, slow, square in zip(imu[:2], self.quick, self.slow, self.square, strict=True):
            now = quick + to_quick * (float(shown) - quick)
            mean = slow + to_slow * (now - slow)
            axes.append((now, mean, square + to_square * ((now - mean) ** 2 - square)))
        forward, starboard = axes
        return Waves(*zip(forward, starboard, strict=True))
