"""Output files of a voyage: the daemon's configuration and the ground truth, beside the ports."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from common.angles import wrap_deg
from common.boat_config import BoatConfig, FramesTable, LinkTable, PortTable, SensorTable
from common.simulation.motion import Array, grid
from common.simulation.voyage import Voyage
from onboard.virtual.boat import PORTS

TRUTH_HEADER = "t_s,lat_deg,lon_deg,heading_true_deg,t_ns,east_m,north_m,v_east_m_s,v_north_m_s"
TRUTH_RATE_HZ = 10.0
LONGEST_GAP_S = 1.0
"""Longest hole of a recording's reference over which the truth is interpolated, s."""


def boat_config(voyage: Voyage, ports: dict[str, str], bind: str) -> BoatConfig:
    """The daemon's configuration for the ports (name -> path) of a virtual boat."""
    facts, rates = voyage.facts, voyage.rates
    latency = {plan.name: float(plan.latency_ms) for plan in PORTS}
    return BoatConfig(
        # the compass line carries true - variation, and 0 where the voyage has none
        boat=replace(voyage.boat, variation_deg=voyage.boat.variation_deg or 0.0),
        frames=FramesTable(),
        link=LinkTable(bind=bind),
        port=tuple(PortTable(name=plan.name, path=ports[plan.name], baud=plan.baud) for plan in PORTS),
        sensor=(
            SensorTable(
                id="gps1",
                port="gps",
                role="gps",
                rate_hz=rates.gps_hz,
                latency_ms=latency["gps"],
                sigma_m=facts.sigma_m,
            ),
            SensorTable(
                id="compass1",
                port="compass",
                role="compass",
                rate_hz=rates.compass_hz,
                latency_ms=latency["compass"],
                sigma_deg=facts.sigma_deg,
            ),
            SensorTable(
                id="imu1",
                port="imu",
                role="imu",
                model="arduimu",
                rate_hz=rates.imu_hz,
                latency_ms=latency["imu"],
                accel_density=facts.accel_density,
                gyro_density_deg=facts.gyro_density_deg,
                bias_accel_sigma_m_s2=facts.bias_accel_sigma_m_s2,
                bias_accel_walk_m_s2=facts.bias_accel_walk_m_s2,
                bias_yaw_rate_sigma_deg_s=facts.bias_yaw_rate_sigma_deg_s,
                bias_yaw_rate_walk_deg_s=facts.bias_yaw_rate_walk_deg_s,
                tilt_leak_sigma_per_m=facts.tilt_leak_sigma_per_m,
                use=facts.use,
            ),
        ),
    )


class TruthFile:
    """Truth at 10 Hz. All but the boat time is worked out beforehand: writing must not delay the first byte."""

    def __init__(self, voyage: Voyage) -> None:
        truth = voyage.truth.at(_covered(voyage.truth.t_s))
        columns = (truth.t_s, truth.east_m, truth.north_m, np.degrees(truth.heading_rad))
        velocity = (truth.v_east_m_s, truth.v_north_m_s)
        self._rows: list[tuple[float, str, str]] = []
        for t_s, east, north, heading, v_east, v_north in np.stack((*columns, *velocity), axis=1).tolist():
            lat, lon = voyage.plane.to_lat_lon_deg(east, north)
            before = f"{t_s:.3f},{lat:.9f},{lon:.9f},{wrap_deg(heading):.4f}"
            self._rows.append((t_s, before, f"{east:.4f},{north:.4f},{v_east:.5f},{v_north:.5f}"))

    def write(self, path: Path, start_ns: int) -> None:
        """Write it; t = 0 is boat time `start_ns`."""
        rows = (f"{before},{start_ns + round(t_s * 1e9)},{after}\n" for t_s, before, after in self._rows)
        path.write_text(f"{TRUTH_HEADER}\n{''.join(rows)}", encoding="ascii")


def _covered(t_s: Array) -> Array:
    """The times of the truth file that lie on the truth's own or between two that are close."""
    times = grid(float(t_s[-1]), TRUTH_RATE_HZ)
    times = times[times >= t_s[0]]
    after = np.searchsorted(t_s, times)
    before = np.searchsorted(t_s, times, side="right") - 1
    covered: Array = times[t_s[after] - t_s[before] <= LONGEST_GAP_S]
    return covered
