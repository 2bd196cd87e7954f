"""The posterior Cramer-Rao bound: the least mean squared error that any filter can have on a scenario.

Recursive information form of P. Tichavsky, C. Muravchik, A. Nehorai, IEEE Trans. Signal Processing 46 (1998),
Eq. 21 in the form for additive noise, along the true track with the true noise of each step:

    J(k) = (F J(k-1)^-1 F^T + B S B^T)^-1 + H^T R^-1 H

J information (n, n); F, B derivatives of the motion by state and by IMU input at the truth; S variances of the input;
H, R of what is measured at this step. n = 5, or 8 with gyro bias and two accelerometer biases to be found as well.
Written apart from the filters on purpose: their process noise and rotation are judged by it.
"""

from typing import Final

import numpy as np

from common.simulation.monte_carlo_runs import Runs
from shore.navigation.numbers import Array
from shore.navigation.state_space import EAST, HEADING, NORTH, V_EAST

_UNITS: Final = np.array([1.0, 1.0, np.degrees(1.0) ** 2])


def posterior_bound(runs: Runs, start: Array, *, moored: bool = False) -> Array:
    """Least variances (k, 3) of east (m^2), north (m^2) and heading (deg^2) at each step; row 0 is the start.

    start: P(1), (5,) or (8,) variances; the extra three are those of the biases. moored: the filter may know that the
    boat does not move, Eqs 4.5 and 4.8.
    """
    size = len(start)
    J = np.diag(1.0 / start)
    bounds = np.empty((len(runs.truth), 3))
    bounds[0] = start[[EAST, NORTH, HEADING]]
    for k in range(1, len(runs.truth)):
        if not moored:
            F, B = _derivatives(runs.truth[k - 1, HEADING], runs.inputs[k], runs.step_s, size)
            inputs = np.array([*runs.accel_std[k], runs.gyro_std_rad[k]])
            J = np.linalg.inv(F @ np.linalg.inv(J) @ F.T + (B * np.square(inputs)) @ B.T)
        if runs.has_gps[k]:
            J[EAST, EAST] += 1.0 / runs.gps_m[k, 0] ** 2
            J[NORTH, NORTH] += 1.0 / runs.gps_m[k, 1] ** 2
        if runs.has_compass[k]:
            J[HEADING, HEADING] += 1.0 / runs.compass_sigma_rad[k] ** 2
        bounds[k] = np.linalg.inv(J).diagonal()[[EAST, NORTH, HEADING]]
    bounds *= _UNITS
    return bounds


def _derivatives(heading_rad: float, inputs: Array, step_s: float, size: int) -> tuple[Array, Array]:
    """F (n, n) and B (n, 3) of one step; inputs: true forward, starboard (m/s^2) and yaw rate (rad/s)."""
    fwd, stb, yaw_rate = inputs
    middle = heading_rad + 0.5 * step_s * yaw_rate
    sin, cos = np.sin(middle), np.cos(middle)
    turned = np.array([[sin, cos], [cos, -sin]])
    by_heading = np.array([cos * fwd - sin * stb, -sin * fwd - cos * stb])
    B = np.zeros((size, 3))
    F = np.eye(size)
    for first, gain in ((EAST, 0.5 * step_s**2), (V_EAST, step_s)):
        B[first : first + 2, :2] = gain * turned
        B[first : first + 2, 2] = gain * 0.5 * step_s * by_heading
        F[first : first + 2, HEADING] = gain * by_heading
    B[HEADING, 2] = step_s
    F[EAST, V_EAST] = F[NORTH, V_EAST + 1] = step_s
    if size > HEADING + 1:  # a bias that the IMU shows too much acts against its input: yaw rate, forward, starboard
        F[:, HEADING + 1 :] -= B[:, [2, 0, 1]]
    return F, B
