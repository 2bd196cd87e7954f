"""Tracks of known motion: at rest, in a steady turn, rolling on the spot."""

from dataclasses import replace

import numpy as np

from common.simulation.motion import Truth

STEP_S = 0.05


def still(seconds: float, heading_deg: float = 0.0, roll_deg: float = 0.0, pitch_deg: float = 0.0) -> Truth:
    """A boat that does not move, tilted as asked."""
    t_s = np.arange(round(seconds / STEP_S) + 1, dtype=np.float64) * STEP_S
    zero, one = np.zeros_like(t_s), np.ones_like(t_s)
    roll, pitch = np.radians(roll_deg) * one, np.radians(pitch_deg) * one
    return Truth(t_s, zero, zero, zero, zero, np.radians(heading_deg) * one, roll_rad=roll, pitch_rad=pitch)


def circling(seconds: float, speed_m_s: float, turn_deg_s: float, roll_deg: float = 0.0) -> Truth:
    """A steady turn with a constant list, + starboard down."""
    t_s = np.arange(round(seconds / STEP_S) + 1, dtype=np.float64) * STEP_S
    rate = np.radians(turn_deg_s)
    heading = rate * t_s
    east, north = speed_m_s / rate * (1.0 - np.cos(heading)), speed_m_s / rate * np.sin(heading)
    level = np.zeros_like(t_s)
    return Truth(
        t_s,
        east,
        north,
        speed_m_s * np.sin(heading),
        speed_m_s * np.cos(heading),
        heading,
        roll_rad=level + np.radians(roll_deg),
        pitch_rad=level,
    )


def rolling(seconds: float, heading_deg: float, roll_deg: float, hz: float) -> Truth:
    """A boat that rolls on the spot."""
    rest = still(seconds, heading_deg)
    roll = np.radians(roll_deg) * np.sin(2.0 * np.pi * hz * rest.t_s)
    return replace(rest, roll_rad=roll)
