"""Facts of the boat's sensors, from its file to the filters: R0, bias states and their walks, process noise, levers."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from common.boat_config import ROLES, BoatConfig, SensorTable
from shore.navigation.imu_track import driving_sensor
from shore.navigation.measurements import Lever
from shore.navigation.motion_model import FREE_NOISE, ProcessNoise
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.state_space import EXTRA_NAMES, FIVE, Extra, StateSpace
from shore.navigation.tilt_leak import LARGEST_LEAK_PER_M
from shore.navigation.trust.memory import Vessel

CURRENT_WALK: Final = 0.01
"""Density of the current's random walk, m/s / sqrt(s): 0.5 m/s in 40 min."""
WAY_SIGMA_M_S: Final = 2.0
"""1-sigma of the way before anything is known, m/s."""
WAY_WALK: Final = 0.1 / math.sqrt(300.0)
"""Density of the way's random walk, m/s / sqrt(s): wind, thrust."""
DEVIATION_WALK: Final = math.radians(0.02)
"""Density of the random walk of a deviation's coefficients, rad / sqrt(s): 1 deg in 40 min."""
LEVELLED_SHARE: Final = 0.1
"""What is left of the leaks of gravity where roll and pitch take it out."""
COURSE_SIGMA_DEG: Final = 20.0
"""A course over ground taken as heading (boats without compass): leeway, current and sideways motion of the antenna."""


@dataclass(frozen=True, slots=True)
class FilterFacts:
    """What a filter must know of the boat's sensors."""

    channels: Mapping[str, Channel]
    """Channels of the sensors by name: `gps1.east`, `gps1.north`, `gps1.course`, `compass1.heading`, ..."""
    space: StateSpace = FIVE
    """The states that it estimates, (n,)."""
    imu_noise: ProcessNoise = FREE_NOISE
    """Process noise of a step that an IMU sample covers."""
    free_noise: ProcessNoise = FREE_NOISE
    """Process noise of a step without IMU."""
    levers: Mapping[str, Lever] = field(default_factory=dict)
    """Lever arm of each sensor; absent = its antenna is at the reference point."""
    boat: Vessel | None = None
    """How a real boat's filter weighs its sensors; `None` = every sensor is what its channel says."""

    @property
    def plain(self) -> "FilterFacts":
        """The same for a filter that takes every sensor for what its channel says."""
        own = (*EXTRA_NAMES[:4],)
        space = StateSpace(tuple(extra for extra in self.space.extras if extra.name in own))
        return replace(self, space=space, boat=None)


def facts_of(config: BoatConfig) -> FilterFacts:
    """What the boat's configuration says: R0 from the sigmas; states and process noise from what drives it."""
    channels: dict[str, Channel] = {}
    levers = {}
    for sensor in config.with_role("gps"):
        for component in ("east", "north"):
            channels[f"{sensor.id}.{component}"] = Channel(sensor.sigma_m**2, _rate_hz(sensor))
        channels[f"{sensor.id}.course"] = Channel(math.radians(COURSE_SIGMA_DEG) ** 2, _rate_hz(sensor))
        if sensor.lever_fwd_m or sensor.lever_stb_m:
            levers[sensor.id] = (sensor.lever_fwd_m, sensor.lever_stb_m)
    for sensor in config.with_role("compass"):
        channels[f"{sensor.id}.heading"] = Channel(math.radians(sensor.sigma_deg) ** 2, _rate_hz(sensor))
    driver = driving_sensor(config)
    extras = (*(_inertial(driver) if driver else ()), *_water(config), *_errors(config))
    has_gyro = driver is not None and "yaw_rate" in driver.use
    left = LEVELLED_SHARE if driver is not None and driver.trust_tilt else 1.0
    boat = Vessel(config.boat.leeway_m_s, levers, has_gyro, left)
    imu_noise = _imu_noise(driver) if driver else FREE_NOISE
    return FilterFacts(channels, StateSpace(extras), imu_noise, levers=levers, boat=boat)


def _rate_hz(sensor: SensorTable) -> float:
    return sensor.rate_hz or ROLES[sensor.role].nominal_rate_hz


def _inertial(imu: SensorTable) -> tuple[Extra, ...]:
    """States of the axes that are used; a prior of 0 = no such state."""
    extras = []
    left = LEVELLED_SHARE if imu.trust_tilt else 1.0
    if "yaw_rate" in imu.use:
        sigma, walk = np.radians([imu.bias_yaw_rate_sigma_deg_s, imu.bias_yaw_rate_walk_deg_s]).tolist()
        extras.append(Extra("gyro_bias_rad_s", sigma, walk))
    for axis, name in (("accel_fwd", "accel_bias_fwd_m_s2"), ("accel_stb", "accel_bias_stb_m_s2")):
        if axis in imu.use:
            extras.append(Extra(name, imu.bias_accel_sigma_m_s2, imu.bias_accel_walk_m_s2))
    if "accel_fwd" in imu.use:
        extras.append(Extra("tilt_leak_per_m", left * imu.tilt_leak_sigma_per_m, limit=LARGEST_LEAK_PER_M))
    if "yaw_rate" in imu.use and "accel_stb" in imu.use:
        extras.append(Extra("heel_leak", left * imu.heel_leak_sigma))
    return tuple(extras)


def _water(config: BoatConfig) -> tuple[Extra, ...]:
    """Current and way, where the boat goes where its bow points."""
    boat = config.boat
    if not boat.leeway_m_s or not config.with_role("gps"):
        return ()
    return (
        Extra("current_east_m_s", boat.current_sigma_m_s, CURRENT_WALK),
        Extra("current_north_m_s", boat.current_sigma_m_s, CURRENT_WALK),
        Extra("way_m_s", WAY_SIGMA_M_S, WAY_WALK),
    )


def _errors(config: BoatConfig) -> Iterator[Extra]:
    """What lasts in the error of each receiver and of each compass."""
    for sensor in config.with_role("gps"):
        for axis in ("east", "north"):
            yield Extra(f"{sensor.id}_error_{axis}_m", sensor.sigma_m, lasts_s=sensor.error_lasts_s)
    for sensor in config.with_role("compass"):
        bias, deviation = np.radians([sensor.compass_bias_sigma_deg, sensor.compass_deviation_sigma_deg]).tolist()
        yield Extra(f"{sensor.id}_bias_rad", bias, lasts_s=sensor.compass_bias_lasts_s)
        yield Extra(f"{sensor.id}_sin_rad", deviation, DEVIATION_WALK)
        yield Extra(f"{sensor.id}_cos_rad", deviation, DEVIATION_WALK)


def _imu_noise(imu: SensorTable) -> ProcessNoise:
    """Densities while the IMU delivers: an axis that is not used moves freely."""
    return ProcessNoise(
        imu.accel_density if "accel_fwd" in imu.use else FREE_NOISE.accel_fwd,
        imu.accel_density if "accel_stb" in imu.use else FREE_NOISE.accel_stb,
        math.radians(imu.gyro_density_deg) if "yaw_rate" in imu.use else FREE_NOISE.yaw_rate,
    )
