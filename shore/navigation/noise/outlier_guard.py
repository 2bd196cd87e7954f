"""Outlier gate (soft) of the station's fuzzy rule: a single jump of the GPS moves nothing and is soon forgotten.

It asks whether what was seen is what a healthy sensor shows, the fuzzy set "equal". n squares of innovations have the
log of their degree of matching at 0 +- sqrt(2 / n), so that width is the unit of the set. The rule asks it of its short
window; the gate asks it of the newest sample alone, a window of n = 1. If that one is "large", R of its own update
rises to what it shows, so that the boat stays where it is, and the windows learn from it no more than the edge of
"equal".
"""

import math
from typing import Final

from shore.navigation.numbers import Number, clip, larger, log, smaller, sqrt

FULL_WIDTHS: Final = 2.5
"""Distance up to which the set "equal" is full, in widths of log DoM; one healthy window in a hundred is beyond."""
EMPTY_WIDTHS: Final = 3.5
"""Distance from which on the set "equal" is empty, in the same widths. In between memberships blend, so that
nothing turns on a hair. Both distances may be 30 % off."""
LARGEST_EQUAL: Final = math.exp(FULL_WIDTHS * math.sqrt(2.0))
"""Innovation squared / expected up to which a single sample is "equal": 34, so 5.9 sigma."""


def not_equal(dom_ratio: Number, entries: Number) -> Number:
    """Membership of "small or large": 0 = what `entries` samples of a healthy sensor show, 1 = certainly not."""
    dom_ratio = larger(dom_ratio, 1e-30)
    widths = log(larger(dom_ratio, 1.0 / dom_ratio)) * sqrt(0.5 * entries)
    return clip((widths - FULL_WIDTHS) / (EMPTY_WIDTHS - FULL_WIDTHS), 0.0, 1.0)


def winsorised(square: Number, expected: Number) -> Number:
    """What the windows learn from a squared innovation: no more than a healthy sensor can show.

    `expected` = C_T, the variance of the innovation; all in m^2 or rad^2.
    """
    return smaller(square, LARGEST_EQUAL * expected)


def guarded(learned: Number, square: Number, expected: Number) -> Number:
    """R of this one update: `learned`, and what the newest sample alone shows as far as it is "large"."""
    large = not_equal(larger(square / expected, 1.0), 1.0)
    return learned + large * (square - expected)
