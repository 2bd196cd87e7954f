"""Measurement difference method: a sensor's white noise variance from third differences, a bound on the learned R.

Innovations grow when a sensor is bad and when the prediction is bad (a stuck IMU, a heeling hull), and a rule that
learns R from them blames the sensor for both. What a sensor says of itself needs no prediction: over a few seconds the
way of a boat is nearly a parabola, and the third divided difference of four readings cancels a parabola exactly, at
whatever times they were made. What is left is the sensor's own scatter:

    w_i = 1 / prod_{j != i} (t_i - t_j),  w /= |w|,  d = sum w_i z_i,  E d^2 = white variance,
    S <- (1 - 1/60) S + min(d^2, 16 S/W),  W <- (1 - 1/60) W + 1.

The simplest case of the method of J. Dunik, O. Kost, O. Straka, Automatica 90, 2018, and of O. Kost, J. Dunik, I.
Puncochar, O. Straka, *Unobservable Systems: No Problem for Noise Identification*, arXiv 2505.23983. Errors that last
longer than some seconds do not appear in d, so S/W is no estimate of R, only a bound on what is learned.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from common.units import NS_PER_S
from shore.navigation.numbers import Number, choose, larger, smaller, wrapped

MEMORY: Final = 60.0
"""Differences that S/W remembers: it is known to 18 %, the bound to 9 % of a sigma. 30 and 120 are as good."""
PRIOR_WEIGHT: Final = 5.0
"""Differences that the prior counts for: a sensor 7 times worse than told is found within some ten readings."""
POSITION_PRIOR: Final = 0.7**2
"""White share of R0 of what is not an angle: a receiver's sigma holds its slow errors too."""
IN_FORCE_FROM: Final = 15.0
"""W from which on R is bounded, twelve differences: before that, a sensor 7 times worse than told would be held to what
it was told (`imm` in 5.2: 1.28 of the oracle's squared heading error for 1.05). From then on one such sensor in 70 is
bounded below its own variance, from 20 readings on one in 400."""
LARGEST_SQUARE: Final = 16.0
"""A difference beyond 4 sigma adds to S no more than that: a jump is in four differences."""
TIMES_SCATTER: Final = 9.0
"""R may be this many times S/W, three sigmas for one: a rule has room for errors of a few seconds, which S/W does not
see, and with 4 the heading of the thesis' scenario 5.2 suffers (1.047 of the oracle's squared error for 1.02)."""
JUMP_SQUARE: Final = 4.0
"""From here on, in S/W, the newest difference shows a jump (a healthy sensor in one reading of twenty)."""
POSITION_SPACING_NS: Final = NS_PER_S * 9 // 10
ANGLE_SPACING_NS: Final = NS_PER_S * 9 // 100
"""Readings nearer to the last one are left out: receivers smooth over a second. A tenth less than a second and a tenth
of one, for stamps jitter. A heading turns too quickly for a second."""
LONGEST_SPAN_NS: Final = 6 * 3600 * NS_PER_S
"""Readings over a longer time are not compared."""

Reading = tuple[int, Number]
"""Boat time, ns, and what was measured then, m or rad."""


class Scatter(NamedTuple):
    """What is remembered of one channel's own scatter; immutable."""

    squares: Number
    """S, fading sum of squared differences, m^2 or rad^2."""
    weight: float
    """W, fading number of differences."""
    is_angle: bool
    """True for readings that wrap."""
    readings: tuple[Reading, ...] = ()
    """The last three that are far enough apart, oldest first."""

    @classmethod
    def first(cls, initial_variance: float, *, is_angle: bool) -> "Scatter":
        """Before any reading: the white share of R0."""
        prior = initial_variance if is_angle else POSITION_PRIOR * initial_variance
        return cls(PRIOR_WEIGHT * prior, PRIOR_WEIGHT, is_angle)

    @property
    def variance(self) -> Number:
        """White variance S/W, m^2 or rad^2."""
        return self.squares / self.weight

    def then(self, reading: Reading, *, counts: bool = True) -> "Scatter":
        """With the newest reading; `counts` = False: S and W know it already."""
        t_ns, _ = reading
        readings = self.readings
        if readings:
            spacing_ns = ANGLE_SPACING_NS if self.is_angle else POSITION_SPACING_NS
            if t_ns - readings[-1][0] < spacing_ns:
                return self
            if t_ns - readings[0][0] > LONGEST_SPAN_NS:
                return self._replace(readings=(reading,))
        after = (*readings[-2:], reading)
        if len(readings) < 3 or not counts:
            return self._replace(readings=after)
        d, _ = self.difference(reading)
        fade = 1.0 - 1.0 / MEMORY
        squares = fade * self.squares + smaller(d * d, LARGEST_SQUARE * self.variance)
        return Scatter(squares, fade * self.weight + 1.0, self.is_angle, after)

    def difference(self, reading: Reading) -> tuple[Number, float]:
        """Normalised third difference d of the three readings and a newer one, and the share of the newer one in it."""
        (t0, z0), (t1, z1), (t2, z2), (t3, z3) = *self.readings, reading
        a, b, c = (t1 - t0) / NS_PER_S, (t2 - t1) / NS_PER_S, (t3 - t2) / NS_PER_S
        w0, w1 = -1.0 / (a * (a + b) * (a + b + c)), 1.0 / (a * b * (b + c))
        w2, w3 = -1.0 / ((a + b) * b * c), 1.0 / ((a + b + c) * (b + c) * c)
        y0, y2, y3 = z0 - z1, z2 - z1, z3 - z1
        if self.is_angle:
            y0, y2, y3 = wrapped(y0), wrapped(y2), wrapped(y3)
        length = math.sqrt(w0 * w0 + w1 * w1 + w2 * w2 + w3 * w3)
        return (w0 * y0 + w2 * y2 + w3 * y3) / length, w3 / length


def bound(initial_variance: float, scatter: Scatter) -> Number:
    """Largest R that may be learned: 9 S/W and, whatever the scatter, R0; m^2 or rad^2.

    R0 is the least bound: fixes that are held, a compass of whole degrees at rest, and errors that last for minutes
    scatter by nothing, and are no more precise for it.
    """
    if scatter.weight < IN_FORCE_FROM:
        return math.inf
    return larger(TIMES_SCATTER * scatter.variance, initial_variance)


def bounded(variance: Number, initial_variance: float, before: Scatter, now: Scatter, reading: Reading) -> Number:
    """R of the update with `reading`, m^2 or rad^2; `before` and `now` are without and with it.

    A jump of this reading raises the bound of its own R to the square of the jump, so that the outlier guards of the
    rules go on to work.
    """
    most = bound(initial_variance, now)
    if not np.any(variance > most):
        return variance
    if len(before.readings) == 3 and reading[0] > before.readings[-1][0]:
        d, share = before.difference(reading)
        jumps = d * d > JUMP_SQUARE * now.variance
        most = choose(jumps, larger(most, (d / share) * (d / share)), most)
    return smaller(variance, most)
