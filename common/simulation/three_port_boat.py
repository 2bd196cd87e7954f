"""The default virtual boat as a boat's file: one receiver, one compass and one inertial unit, a port each."""

from typing import Final

from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.simulation.readings import Rates, SensorFacts

UNSETTLED: Final = "unsettled"
"""Path of a port that is not made yet."""


def three_port_boat(boat: BoatTable, facts: SensorFacts | None = None, rates: Rates | None = None) -> BoatConfig:
    """BU-353, HSC100 and ArduIMU, as far as the facts say it; a receiver's sentence comes 0.3 s after its fix."""
    facts, rates = facts or SensorFacts(), rates or Rates()
    return BoatConfig(
        boat=boat,
        port=(
            PortTable(name="gps", path=UNSETTLED, baud=4800),
            PortTable(name="compass", path=UNSETTLED, baud=4800),
            PortTable(name="imu", path=UNSETTLED, baud=38400),
        ),
        sensor=(
            SensorTable(
                id="gps1", port="gps", role="gps", rate_hz=rates.gps_hz, latency_ms=300.0, sigma_m=facts.sigma_m
            ),
            SensorTable(
                id="compass1",
                port="compass",
                role="compass",
                rate_hz=rates.compass_hz,
                sigma_deg=facts.sigma_deg,
                compass_bias_sigma_deg=facts.compass_bias_sigma_deg,
                compass_deviation_sigma_deg=facts.compass_deviation_sigma_deg,
            ),
            SensorTable(
                id="imu1",
                port="imu",
                role="imu",
                model="arduimu",
                rate_hz=rates.imu_hz,
                accel_density=facts.accel_density,
                gyro_density_deg=facts.gyro_density_deg,
                bias_accel_sigma_m_s2=facts.bias_accel_sigma_m_s2,
                bias_accel_walk_m_s2=facts.bias_accel_walk_m_s2,
                bias_yaw_rate_sigma_deg_s=facts.bias_yaw_rate_sigma_deg_s,
                bias_yaw_rate_walk_deg_s=facts.bias_yaw_rate_walk_deg_s,
                tilt_leak_sigma_per_m=facts.tilt_leak_sigma_per_m,
                heel_leak_sigma=facts.heel_leak_sigma,
                use=facts.use,
            ),
        ),
    )
