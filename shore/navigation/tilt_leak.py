"""Tilt leak: a hull lifts its bow with speed, so the forward accelerometer shows some of gravity, c L, too much.

c = the state `tilt_leak_per_m`. L = A tanh(u |u| / A) is the lift, u the speed through the water along the bow, so that
L = u |u| as long as that is small. The motion model (`motion_model.py`) takes c L off what was measured.
"""

from typing import Final

from shore.navigation.numbers import Number, magnitude, tanh

LARGEST_LEAK_PER_M: Final = 0.4
"""Largest tilt leak |c|, 1/m: without a bound, the product of two uncertain states diverged when it was tried."""

LARGEST_LIFT_M2_S2: Final = 9.0
"""A = (3 m/s)^2: about its hull speed (3 m/s for a boat of 6 m) a boat keeps its trim.
Without this end a wrong c feeds on itself: the faster the boat is thought to be, the harder it is thought to
accelerate. c stays linear: were c L bounded, a filter at the bound would take c for known, and blame the bias."""

TRIM_UNREST: Final = 0.5
"""Factor, sqrt(s): where the bow rises with speed, the forward axis is noisier by it times (1-sigma of c) L. The bow
does not follow the speed at once: for half a second after each change of thrust the leak is wrong by about half of
what is expected of it, and half x sqrt(2 x 0.5 s) = 0.5."""


def lift(along: Number) -> Number:
    """L of a speed along the bow in m/s, m^2/s^2; negative astern."""
    return LARGEST_LIFT_M2_S2 * tanh(along * magnitude(along) / LARGEST_LIFT_M2_S2)


def accel_by_speed(leak: Number, along: Number, lifted: Number) -> Number:
    """Derivative of the forward acceleration, from which c L is taken, by the speed along the bow; 1/s.

    leak: c, 1/m. along: u, m/s. lifted: L at u.
    """
    slope = 1.0 - (lifted / LARGEST_LIFT_M2_S2) ** 2
    return -2.0 * slope * leak * magnitude(along)


def trim_density(sigma_leak: float, lifted: Number) -> Number:
    """White noise that the unrest of the trim adds to the forward axis, m/s^2/sqrt(Hz); sigma_leak: prior of c, 1/m."""
    return TRIM_UNREST * sigma_leak * lifted
