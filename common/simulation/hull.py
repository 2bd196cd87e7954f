"""Manoeuvring model of a small hull: sway in turns, leeway, heel, trim, waves and current, from commands to a `Truth`.

All constants are drawn for each boat. Way and turn follow the commands with a lag (Nomoto's first order). In a turn the
hull slides outward, v -> -k u r with a lag of 2 s, and heels outward by h u r rad: the studies' hull has k = 1.05 s and
h = 0.15 (real-boats.md section 3, honest-filter.md section 8); a BlueBoat, a catamaran, shows k from -0.2 to 1.25 s and
h = 0.01 (benchmarks/real_boats.py), so boats are drawn from none to 1.4 times the studies' hull. It lifts its bow by
c u^2: a BlueBoat shows 0.165 to 0.3 u |u| m/s^2 of gravity in its forward accelerometer, so c is 0.0168 rad/(m/s)^2 and
more (README of the recordings, and the same benchmark), up to the trim of a planing hull. A turn costs way.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from common.simulation.motion import Array, Truth
from common.simulation.recurrences import lagged
from common.simulation.waves import Sea, in_waves, narrow_band, wandering

STEP_S: Final = 0.05
HEEL_MOST_RAD: Final = 0.35
"""Heel in a turn bends towards 20 degrees and stays below."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hull:
    """One boat's constants."""

    slide_s: float
    """Factor k of the outward slide in a turn, v = -k u r, s."""
    slide_lag_s: float
    way_lag_s: float
    turn_lag_s: float
    heel_s2_m: float
    """Outward heel for each u r, rad/(m/s^2)."""
    trim_s2_m2: float
    """Bow up for each u^2, rad/(m/s)^2."""
    trim_most_rad: float
    way_lost_s: float
    """Share of the way that a turn costs for each rad/s."""
    leeway: float
    """Drift down the wind as a fraction of the wind's speed."""
    wander_deg: float
    """1-sigma of the heading about the helm's course."""


def drawn_hull(rng: np.random.Generator) -> Hull:
    """A hull somewhere about the middle one of the studies."""
    return Hull(
        slide_s=1.05 * rng.uniform(0.0, 1.4),
        slide_lag_s=2.0 * rng.uniform(0.6, 1.4),
        way_lag_s=rng.uniform(2.0, 6.0),
        turn_lag_s=rng.uniform(0.4, 1.5),
        heel_s2_m=0.15 * rng.uniform(0.0, 1.4),
        trim_s2_m2=0.0168 * rng.uniform(0.5, 1.8),
        trim_most_rad=np.radians(rng.uniform(4.0, 8.0)),
        way_lost_s=rng.uniform(0.3, 1.2),
        leeway=rng.uniform(0.005, 0.025),
        wander_deg=rng.uniform(0.3, 1.2),
    )


@dataclass(frozen=True, slots=True)
class Commands:
    """What the helm asks for at each step of the time grid, (n,): way through the water and turn, + clockwise."""

    way_m_s: Array
    turn_rad_s: Array


@dataclass(frozen=True, slots=True)
class Course:
    """A hull's motion before waves, wind and current, at each step, (n,) or (n, 2)."""

    heading_rad: Array
    turn_rad_s: Array
    way_m_s: Array
    """Velocity through the water along the bow, m/s."""
    slide_m_s: Array
    """Velocity through the water to starboard, m/s."""
    swing_m_s: Array | None = None
    """Velocity over ground, east and north (n, 2), of a boat that its anchor holds against wind and current."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Weather:
    """What moves the boat besides itself, for the middle boat of a scenario."""

    sea: Sea
    current_m_s: float
    """Largest mean of the current; each boat draws 0 to this, and it wanders by a fifth of this over 300 s."""
    wind_m_s: float
    """Largest mean of the wind, in the same way; gusts of a fifth last 20 s."""


def steered(rng: np.random.Generator, t_s: Array, commands: Commands, hull: Hull) -> Course:
    """How the hull follows its helm; the heading hunts about the course with a period of 12 to 30 s."""
    asked = lagged(commands.turn_rad_s, STEP_S, hull.turn_lag_s)
    way = lagged(commands.way_m_s * np.exp(-hull.way_lost_s * np.abs(asked)), STEP_S, hull.way_lag_s)
    hunting = narrow_band(rng, t_s, np.radians(hull.wander_deg), rng.uniform(1 / 30, 1 / 12), 0.25)
    heading = rng.uniform(0.0, 2.0 * np.pi) + integral(asked) + hunting
    turn = _rates(heading)
    return Course(heading, turn, way, lagged(-hull.slide_s * way * turn, STEP_S, hull.slide_lag_s))


def at_anchor(rng: np.random.Generator, t_s: Array) -> Course:
    """A boat that lies downwind of its anchor and sheers about it, while the wind goes round.

    A rode of 15 to 40 m; it sheers with a period of 40 to 120 s at 0.1 to 0.4 m/s (1-sigma), 25 deg at most, its bow
    off the rode on the side it moves to: yacht hulls that sheer are seen to do so, the numbers are ours.
    """
    rode, period_s, sheer_m_s = rng.uniform((15.0, 40.0, 0.1), (40.0, 120.0, 0.4)).tolist()
    rode_m = rode + narrow_band(rng, t_s, rng.uniform(0.3, 1.5), 1 / rng.uniform(20, 60), 0.25)
    sheer_rad = min(sheer_m_s * period_s / (2.0 * np.pi * rode), np.radians(25.0))
    sheer = narrow_band(rng, t_s, sheer_rad, 1 / period_s, 0.25)
    veer = narrow_band(rng, t_s, np.radians(rng.uniform(5.0, 20.0)), 1 / rng.uniform(300, 900), 0.4)
    bearing = rng.uniform(0.0, 2.0 * np.pi) + veer + sheer
    place = rode_m[:, np.newaxis] * np.stack((np.sin(bearing), np.cos(bearing)), axis=1)
    heading = bearing + np.pi - rng.uniform(2.0, 6.0) * _rates(bearing)
    still = np.zeros_like(t_s)
    return Course(heading, still, still, still, _rates(place))


def afloat(rng: np.random.Generator, t_s: Array, course: Course, hull: Hull, weather: Weather) -> Truth:
    """The truth of a hull in waves, wind and current; positions are the exact integral of its velocities.

    A wave turns the bow to and fro, not the way of the boat.
    """
    waves = in_waves(rng, t_s, weather.sea)
    sin, cos = np.sin(course.heading_rad), np.cos(course.heading_rad)
    fwd, stb = course.way_m_s + waves.fwd_m_s, course.slide_m_s + waves.stb_m_s
    drift = _drift(rng, t_s, hull, weather) if course.swing_m_s is None else course.swing_m_s
    v_east, v_north = sin * fwd + cos * stb + drift[:, 0], cos * fwd - sin * stb + drift[:, 1]
    heel = HEEL_MOST_RAD * np.tanh(hull.heel_s2_m * course.way_m_s * course.turn_rad_s / HEEL_MOST_RAD)
    trim = hull.trim_most_rad * np.tanh(hull.trim_s2_m2 * course.way_m_s**2 / hull.trim_most_rad)
    return Truth(
        t_s,
        integral(v_east),
        integral(v_north),
        v_east,
        v_north,
        course.heading_rad + waves.yaw_rad,
        roll_rad=waves.roll_rad - lagged(heel, STEP_S, 0.7),
        pitch_rad=waves.pitch_rad + lagged(trim, STEP_S, 1.0),
    )


def _drift(rng: np.random.Generator, t_s: Array, hull: Hull, weather: Weather) -> Array:
    """Current and leeway, (n, 2). Each has its own generator, for how much it draws depends on the length."""
    water, air = (np.random.default_rng(seed) for seed in rng.integers(0, 2**63, 2).tolist())
    current = wandering(water, t_s, water.uniform(0.0, weather.current_m_s), 0.2 * weather.current_m_s, 300.0)
    wind = wandering(air, t_s, air.uniform(0.0, weather.wind_m_s), 0.2 * weather.wind_m_s, 20.0)
    return current + hull.leeway * wind


def integral(rates: Array) -> Array:
    """Integral from 0 of what changes linearly within each step (trapezoids), (n,)."""
    return np.concatenate(([0.0], np.cumsum(0.5 * STEP_S * (rates[1:] + rates[:-1]))))


def _rates(values: Array) -> Array:
    """Rate of change over the step before each row, the first as the second."""
    rates: Array = np.diff(values, axis=0) / STEP_S
    return np.concatenate((rates[:1], rates))
