"""Facts of the boat's sensors, from its file to the filters: R0, bias states and their walks, process noise, levers."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from common.boat_config import ROLES, BoatConfig, SensorTable
from shore.navigation.imu_track import driving_sensor
from shore.navigation.measurements import Lever
from shore.navigation.motion_model import FIVE, FREE_NOISE, Extra, ProcessNoise, StateSpace
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.tilt_leak import LARGEST_LEAK_PER_M

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
    if driver := driving_sensor(config):
        return FilterFacts(channels, _space(driver), _imu_noise(driver), levers=levers)
    return FilterFacts(channels, levers=levers)


def _rate_hz(sensor: SensorTable) -> float:
    return sensor.rate_hz or ROLES[sensor.role].nominal_rate_hz


def _space(imu: SensorTable) -> StateSpace:
    """The thesis' states and those of the axes that are used; a prior of 0 = no such state."""
    extras = []
    if "yaw_rate" in imu.use:
        sigma, walk = np.radians([imu.bias_yaw_rate_sigma_deg_s, imu.bias_yaw_rate_walk_deg_s]).tolist()
        extras.append(Extra("gyro_bias_rad_s", sigma, walk))
    for axis, name in (("accel_fwd", "accel_bias_fwd_m_s2"), ("accel_stb", "accel_bias_stb_m_s2")):
        if axis in imu.use:
            extras.append(Extra(name, imu.bias_accel_sigma_m_s2, imu.bias_accel_walk_m_s2))
    if "accel_fwd" in imu.use:
        extras.append(Extra("tilt_leak_per_m", imu.tilt_leak_sigma_per_m, limit=LARGEST_LEAK_PER_M))
    return StateSpace(tuple(extras))


def _imu_noise(imu: SensorTable) -> ProcessNoise:
    """Densities while the IMU delivers: an axis that is not used moves freely."""
    return ProcessNoise(
        imu.accel_density if "accel_fwd" in imu.use else FREE_NOISE.accel_fwd,
        imu.accel_density if "accel_stb" in imu.use else FREE_NOISE.accel_stb,
        math.radians(imu.gyro_density_deg) if "yaw_rate" in imu.use else FREE_NOISE.yaw_rate,
    )
