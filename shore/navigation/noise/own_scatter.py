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

from common.units import NS_PER_S
from shore.navigation.numbers import Number, choose, larger, smaller, wrapped

KEPT: Final = 1.0 - 1.0 / 60.0
"""S/W remembers 60 differences: it is known to 18 %, the bound to 9 % of a sigma. 30 and 120 are as good."""
PRIOR_WEIGHT: Final = 5.0
"""Differences that the prior counts for: a sensor 7 times worse than told is found within some ten readings."""
POSITION_PRIOR: Final = 0.7**2
"""White share of R0 of what is not an angle: a receiver's sigma holds its slow errors too."""
IN_FORCE_FROM: Final = 15.0
"""W from which on R is bounded, twelve differences: before that, a sensor 7 times worse than told would be held to what
it was told (`imm` in 5.2: 1.28 of the oracle's squared heading error for 1.05). From then on one such sensor in 70 is
bounded below its own variance, from 20 readings on one in 400."""
LARGEST_SQUARE: Final = 16.0
"""A difference beyond 4 sigma is a jump of the sensor itself. It adds to S no more than that, for a jump is in three
differences, and it raises the bound to its own square."""
JUMP_NS: Final = 15 * NS_PER_S
"""The bound forgets a jump in this time: long enough to stay where the boat is through a step of 50 m that ends after
30 s, short enough to be at a step of 300 m that lasts within two minutes."""
TIMES_SCATTER: Final = 9.0
"""R may be this many times S/W, three sigmas for one: a rule has room for errors of a few seconds, which S/W does not
see, and with 4 the heading of the thesis' scenario 5.2 suffers (1.047 of the oracle's squared error for 1.02)."""
SPACING_NS: Final = NS_PER_S * 9 // 10
"""Readings nearer to the last one are left out: receivers smooth over a second, and the swing of a compass in waves
must show (with 0.09 s, the heading's 95 % interval held the truth 2 % of the time less in `real-coast`). A tenth less
than a second, for stamps jitter. Turns show a little too, which only loosens the bound."""
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
    """True for readings that wrap; each is taken on the near side of the one before it."""
    jump: Number = 0.0
    """Square of the latest jumps, which fades, m^2 or rad^2."""
    readings: tuple[Reading, ...] = ()
    """The last three that are far enough apart, oldest first; angles go on beyond a turn."""

    @classmethod
    def first(cls, initial_variance: float, *, is_angle: bool, is_white: bool = False) -> "Scatter":
        """Before any reading: the white share of R0. is_white: all of it is white."""
        prior = initial_variance if is_angle or is_white else POSITION_PRIOR * initial_variance
        return cls(PRIOR_WEIGHT * prior, PRIOR_WEIGHT, is_angle)

    @property
    def variance(self) -> Number:
        """White variance S/W, m^2 or rad^2."""
        return self.squares / self.weight

    def then(self, reading: Reading, *, counts: bool = True) -> "Scatter":
        """With the newest reading; `counts` = False: S and W know it already."""
        squares, weight, is_angle, jump, readings = self
        t_ns, value = reading
        if not readings or t_ns - readings[0][0] > LONGEST_SPAN_NS:
            return Scatter(squares, weight, is_angle, jump, (reading,))
        last_ns, last = readings[-1]
        elapsed_ns = t_ns - last_ns
        if elapsed_ns <= 0:
            return self
        if is_angle:
            value = last + wrapped(value - last)
        is_near = elapsed_ns < SPACING_NS
        if len(readings) < 3:
            return self if is_near else Scatter(squares, weight, is_angle, jump, (*readings, (t_ns, value)))
        first, second, third = readings
        square, share = difference(first, second, third, (t_ns, value))
        most = LARGEST_SQUARE * squares / weight
        if (jumps := square > most) is not False:
            jump = choose(jumps, larger(jump, square / share), jump)
            square = smaller(square, most)
        if is_near:
            return Scatter(squares, weight, is_angle, jump, readings)
        if counts:
            squares, weight = KEPT * squares + square, KEPT * weight + 1.0
        jump = jump * (JUMP_NS / (JUMP_NS + elapsed_ns))
        return Scatter(squares, weight, is_angle, jump, (second, third, (t_ns, value)))


def difference(first: Reading, second: Reading, third: Reading, newest: Reading) -> tuple[Number, float]:
    """Square of d, and the newest reading's share in it: d^2 / share = square of what it alone is off a parabola."""
    t0, z0 = first
    t1, z1 = second
    t2, z2 = third
    t3, z3 = newest
    a, b, c = float(t1 - t0), float(t2 - t1), float(t3 - t2)
    ab, bc = a + b, b + c
    abc = ab + c
    # the weights times all six differences of time, for their scale falls out
    w0, w1, w2, w3 = -b * c * bc, c * ab * abc, -a * bc * abc, a * b * ab
    total = w0 * (z0 - z1) + w2 * (z2 - z1) + w3 * (z3 - z1)
    squared = w3 * w3
    length = w0 * w0 + w1 * w1 + w2 * w2 + squared
    return total * total / length, squared / length


def widest(scatter: Scatter) -> Number:
    """Largest R that may be learned where R begins at the sensor's own scatter: 9 S/W, or a late jump; m^2, rad^2."""
    return larger(TIMES_SCATTER * scatter.squares / scatter.weight, scatter.jump)


def bound(initial_variance: float, scatter: Scatter) -> Number:
    """Largest R that may be learned: 9 S/W and, whatever the scatter, R0 and the square of a late jump; m^2 or rad^2.

    R0 is the least bound: fixes that are held, a compass of whole degrees at rest, and errors that last for minutes
    scatter by nothing, and are no more precise for it. A sensor that jumps has itself shown that it errs, so the rules
    with their outlier guards are free to hold it for bad for a while.
    """
    if scatter.weight < IN_FORCE_FROM:
        return math.inf
    usual, jump = TIMES_SCATTER * scatter.squares / scatter.weight, scatter.jump
    if isinstance(usual, float) and isinstance(jump, float):
        return max(usual, jump, initial_variance)
    return larger(larger(usual, jump), initial_variance)
