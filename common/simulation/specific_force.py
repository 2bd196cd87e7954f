"""Strapdown inertial truth: specific force and angular rates of a rolling, pitching hull, forward, starboard, down.

Euler angles in the order yaw, pitch, roll: p = roll' - yaw' sin(pitch), q = pitch' cos(roll) + yaw' cos(pitch)
sin(roll), r = yaw' cos(pitch) cos(roll) - pitch' sin(roll); the specific force is the acceleration less gravity, turned
into the body (Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2013, ch. 2). For
small angles: forward a_fwd + g sin(pitch), to starboard a_stb - g sin(roll), down -g. The sea does not heave here.
"""

from dataclasses import dataclass

import numpy as np

from common.simulation.motion import Array, Truth
from common.units import STANDARD_GRAVITY_M_S2


@dataclass(frozen=True, slots=True)
class BodyMotion:
    """Means over the steps of a truth, (n - 1, 3) each; row k covers t_s[k] to t_s[k + 1]."""

    t_s: Array
    """The n times of the truth."""
    force_m_s2: Array
    """Specific force forward, to starboard, down, m/s^2."""
    rate_rad_s: Array
    """Angular rates about the same axes: roll + starboard down, pitch + bow up, yaw + bow to starboard."""
    euler_rad: Array
    """Roll, pitch and yaw in the middle of each step."""
    euler_rate_rad_s: Array

    def mean(self, columns: Array, t_s: Array) -> Array:
        """Means of columns (n - 1, k) over the intervals between ascending times (m,) within the truth, (m - 1, k)."""
        step_s = np.diff(self.t_s)[:, np.newaxis]
        sums = np.concatenate((np.zeros((1, columns.shape[1])), np.cumsum(columns * step_s, axis=0)))
        at = np.stack([np.interp(t_s, self.t_s, sums[:, axis]) for axis in range(columns.shape[1])], axis=1)
        means: Array = np.diff(at, axis=0) / np.diff(t_s)[:, np.newaxis]
        return means


def body_motion_3d(truth: Truth) -> BodyMotion:
    """All three axes; a truth without roll and pitch floats level."""
    level = np.zeros_like(truth.t_s)
    roll = level if truth.roll_rad is None else truth.roll_rad
    pitch = level if truth.pitch_rad is None else truth.pitch_rad
    angles = np.stack((roll, pitch, truth.heading_rad), axis=1)
    step_s = np.diff(truth.t_s)
    rates = np.diff(angles, axis=0) / step_s[:, np.newaxis]
    middle = 0.5 * (angles[1:] + angles[:-1])
    sin, cos = np.sin(middle), np.cos(middle)
    sin_r, sin_p, sin_y = sin.T
    cos_r, cos_p, cos_y = cos.T
    a_east, a_north = np.diff(truth.v_east_m_s) / step_s, np.diff(truth.v_north_m_s) / step_s
    a_ahead, a_right = sin_y * a_east + cos_y * a_north, cos_y * a_east - sin_y * a_north
    g = STANDARD_GRAVITY_M_S2
    # Pitch turns ahead and down, then roll turns right and down.
    a_down = sin_p * a_ahead - cos_p * g
    force = np.stack(
        (cos_p * a_ahead + sin_p * g, cos_r * a_right + sin_r * a_down, cos_r * a_down - sin_r * a_right), axis=1
    )
    p = rates[:, 0] - rates[:, 2] * sin_p
    q = rates[:, 1] * cos_r + rates[:, 2] * cos_p * sin_r
    r = rates[:, 2] * cos_p * cos_r - rates[:, 1] * sin_r
    return BodyMotion(truth.t_s, force, np.stack((p, q, r), axis=1), middle, rates)
