"""Filter tuning of a scenario: the sigmas, densities and start that a filter assumes, as a thesis prints them."""

import math
from dataclasses import dataclass
from typing import Final

from common.simulation.readings import SensorFacts

BIAS_ACCEL_M_S2: Final = 0.04
"""Prior of a bias that was left in, a little wider than those of Table 5.4."""
BIAS_YAW_RATE_DEG_S: Final = 0.3
CALIBRATION_S: Final = 60.0
"""Time at rest over which a calibration takes the mean of an IMU."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Assumed:
    """1-sigma that a filter starts from; what the sensors really do is in `SensorErrors`."""

    gps_east_m: float
    gps_north_m: float
    compass_deg: float
    accel_density: float
    """Noise density of the acceleration on both axes, m/s^2/sqrt(Hz)."""
    gyro_density_deg: float
    """Noise density of the yaw rate, deg/s/sqrt(Hz)."""
    start_position_m: float = 1.0
    """Square root of P(1) on each axis, m (Eqs 4.39, 4.43)."""
    start_velocity_m_s: float = 0.1
    """1-sigma of the first velocity on each axis, m/s."""
    start_heading_deg: float = 0.5
    exact_start: bool = False
    """The first state is the true one, though P(1) is not 0; else it is drawn from P(1) about the truth."""

    @property
    def start_sigmas(self) -> tuple[float, float, float, float, float]:
        """Square roots of the diagonal of P(1) in the order of the state, SI: m, m, m/s, m/s, rad."""
        position, velocity = self.start_position_m, self.start_velocity_m_s
        return position, position, velocity, velocity, math.radians(self.start_heading_deg)

    def facts(self, *, is_calibrated: bool) -> SensorFacts:
        """The same as a boat's file says it; a receiver's entry holds one number, so the mean of both axes.

        A calibrated IMU keeps what the mean of a minute at rest leaves of its biases, another one those of Table 5.4 at
        most. Simulated biases are constant, a simulated hull keeps its trim, the compass has white noise alone.
        """
        left = 1.0 / math.sqrt(CALIBRATION_S)
        return SensorFacts(
            sigma_m=0.5 * (self.gps_east_m + self.gps_north_m),
            sigma_deg=self.compass_deg,
            accel_density=self.accel_density,
            gyro_density_deg=self.gyro_density_deg,
            bias_accel_sigma_m_s2=self.accel_density * left if is_calibrated else BIAS_ACCEL_M_S2,
            bias_accel_walk_m_s2=0.0,
            bias_yaw_rate_sigma_deg_s=self.gyro_density_deg * left if is_calibrated else BIAS_YAW_RATE_DEG_S,
            bias_yaw_rate_walk_deg_s=0.0,
            tilt_leak_sigma_per_m=0.0,
            heel_leak_sigma=0.0,
            compass_bias_sigma_deg=0.0,
            compass_deviation_sigma_deg=0.0,
        )
