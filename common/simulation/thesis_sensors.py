"""The thesis' sensor models (white noise by phase, constant bias) for each sensor of any boat's file.

A receiver, a compass, an inertial unit or a rate gyro measures at its own rate; AIS and radar see the ships of
`traffic.py`. The hull floats level here.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from common.boat_config import SensorTable
from common.geodesy import LocalPlane
from common.simulation.motion import Truth, sample_times_s
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Timed, TurnRateReading
from common.simulation.sensor_errors import Flaws
from common.simulation.sensor_models import (
    Draws,
    Phase,
    SensorErrors,
    at_antenna,
    compass_heading_deg,
    gps_position,
    gps_velocity,
    imu_samples,
)
from common.simulation.traffic import traffic_readings

NAMED: Final = ("gps1", "compass1", "imu1")
"""Sensors of which a scenario itself says the errors: those of the three-port boat."""
TILTED: Final = ("tcm2", "hmr3000")
"""Models of compasses that print pitch and roll beside each heading."""


def phases_of(sensor: SensorTable, phases: Sequence[Phase]) -> tuple[Phase, ...]:
    """The phases as one sensor lives them: its own errors, the scenario's, or those of its file in proportion."""
    first = phases[0].errors
    found = []
    for phase in phases:
        own = dict(phase.of_sensor).get(sensor.id)
        if own is None:
            own = phase.errors if sensor.id in NAMED else _in_proportion(sensor, phase.errors, first)
        found.append(replace(phase, errors=own))
    return tuple(found)


def _in_proportion(sensor: SensorTable, now: SensorErrors, first: SensorErrors) -> SensorErrors:
    def scaled(stated: float, name: str) -> float:
        before: float = getattr(first, name)
        return stated * getattr(now, name) / before if before else stated

    return replace(
        now,
        gps_east_m=scaled(sensor.sigma_m, "gps_east_m"),
        gps_north_m=scaled(sensor.sigma_m, "gps_north_m"),
        compass_deg=scaled(sensor.sigma_deg, "compass_deg"),
        accel_density=scaled(sensor.accel_density, "accel_density"),
        gyro_density_deg=scaled(sensor.gyro_density_deg, "gyro_density_deg"),
    )


@dataclass(frozen=True, slots=True)
class ThesisSensor:
    """One sensor of a boat's file, its errors by phase, its flaws and its draws."""

    table: SensorTable
    phases: tuple[Phase, ...]
    flaws: Flaws
    draws: Draws

    def readings(self, truth: Truth, plane: LocalPlane) -> Iterator[Timed]:
        """What it measures over the whole truth, in order of time; a position is that of the antenna."""
        match self.table.role:
            case "gps":
                return self._fixes(truth, plane)
            case "compass":
                return self._headings(truth)
            case "imu" | "gyro":
                return self._samples(truth)
            case _:
                return traffic_readings(truth, self.table, self.draws, plane)

    def _fixes(self, truth: Truth, plane: LocalPlane) -> Iterator[Timed]:
        name, seen = self.table.id, self._when_measured(truth)
        places = gps_position(at_antenna(seen, self.table), self.phases, self.draws, self.flaws, name)[0]
        velocities = gps_velocity(seen, self.phases, self.draws, name)[0]
        for t_s, place, velocity in zip(seen.t_s.tolist(), places.tolist(), velocities.tolist(), strict=True):
            yield Timed(t_s, name, FixReading(*plane.to_lat_lon_deg(*place), *velocity))

    def _headings(self, truth: Truth) -> Iterator[Timed]:
        name, seen = self.table.id, self._when_measured(truth)
        tilt_deg = 0.0 if self.table.model in TILTED else None
        headings = compass_heading_deg(seen, self.phases, self.draws, self.flaws, name)[0]
        if self.table.deviation_deg:  # the file knows it, and the station takes it off
            headings = np.mod(headings - self.table.deviation_deg, 360.0)
        for t_s, heading in zip(seen.t_s.tolist(), headings.tolist(), strict=True):
            yield Timed(t_s, name, HeadingReading(heading, pitch_deg=tilt_deg, roll_deg=tilt_deg))

    def _samples(self, truth: Truth) -> Iterator[Timed]:
        name, seen, is_imu = self.table.id, self._when_measured(truth), self.table.role == "imu"
        samples = imu_samples(seen, self.phases, self.draws, self.flaws, name).values[0]
        samples += (self.table.bias_accel_fwd_m_s2, self.table.bias_accel_stb_m_s2, self.table.bias_yaw_rate_deg_s)
        for t_s, sample in zip(seen.t_s[1:].tolist(), samples.tolist(), strict=True):
            yield Timed(t_s, name, ImuReading(*sample) if is_imu else TurnRateReading(sample[2]))

    def _when_measured(self, truth: Truth) -> Truth:
        return truth.at(sample_times_s(truth, self.table))
