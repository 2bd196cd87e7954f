"""Filter consistency against the smoothed track (NEES): whether the doubt that a filter stated holds its errors.

The smoothed track knows the whole log, also what came later; it stands for the truth. What both get wrong alike, such
as an error of the receiver that lasts, does not show here.
"""

import math
from collections import Counter
from typing import Any, Final, NamedTuple

from common.angles import difference_deg
from common.geodesy import LocalPlane
from shore.navigation.basis import COASTING
from shore.navigation.estimate import Estimate

CHI2_95_2D: Final = 5.991
"""95 % of a chi-squared variable with two degrees of freedom."""
SIGMAS_95: Final = 1.96
RIGHT_FROM: Final = 0.9
"""Share inside 95 % from which a doubt is called right. More than 95 % are expected: both tracks share much."""
AT_REST_M_S: Final = 0.3
TURNS_DEG_S: Final = 3.0
LEAST_COUNT: Final = 50
"""A state of the boat with fewer estimates says nothing."""
STATES: Final = ("at rest", "straight ahead", "turning", "without fixes")


class Stated(NamedTuple):
    """What a filter stated live."""

    lat_deg: float
    lon_deg: float
    east2: float
    """Variance of the place eastwards, m^2."""
    both: float
    """Covariance of the place, east and north, m^2."""
    north2: float
    heading_true_deg: float
    sigma_heading_deg: float
    is_coasting: bool


class OwnDoubt:
    """Compares the estimates of one filter, as they were made live, with the smoothed ones."""

    def __init__(self, name: str) -> None:
        """name: of the filter."""
        self._name = name
        self._live: dict[int, Stated] = {}
        """Estimates as they were stated, by boat time (ns)."""
        self._last: tuple[int, float] | None = None
        """Boat time (ns) and heading (deg) of the last smoothed estimate."""
        self._counts: Counter[str] = Counter()
        self._places: Counter[str] = Counter()
        self._headings: Counter[str] = Counter()
        """Estimates by state of the boat: all, and those whose place, or heading, was within 95 %."""

    def take(self, record: dict[str, Any]) -> None:
        """One estimate (`Estimate.as_record`); those of other filters, or not aligned, count for nothing."""
        if record["filter"] == self._name and record["aligned"] and record["heading_true_deg"] is not None:
            variances = record["covariance"]
            self._live[record["t_ns"]] = Stated(
                record["lat_deg"],
                record["lon_deg"],
                variances[0],
                variances[1],
                variances[len(record["names"])],
                record["heading_true_deg"],
                record["sigma_heading_deg"],
                record["position_from"] == COASTING,
            )

    def compare(self, smoothed: Estimate) -> None:
        """One estimate of the smoothed track, in order of time."""
        last, heading = self._last, smoothed.heading_true_deg
        self._last = None if heading is None else (smoothed.t_ns, heading)
        live = self._live.pop(smoothed.t_ns, None)
        if live is None or heading is None or last is None or smoothed.t_ns <= last[0]:
            return
        turn_deg_s = difference_deg(heading, last[1]) / (1e-9 * (smoothed.t_ns - last[0]))
        state = _state(live, smoothed, turn_deg_s)
        self._counts[state] += 1
        self._places[state] += _nees(live, smoothed) <= CHI2_95_2D
        self._headings[state] += (
            abs(difference_deg(live.heading_true_deg, heading)) <= SIGMAS_95 * live.sigma_heading_deg
        )

    def summary(self) -> dict[str, dict[str, float | int]]:
        """By state of the boat: count, and the shares of places and headings inside 95 % of what was stated."""
        return {
            state: {
                "estimates": self._counts[state],
                "place": round(self._places[state] / self._counts[state], 3),
                "heading": round(self._headings[state] / self._counts[state], 3),
            }
            for state in STATES
            if self._counts[state] >= LEAST_COUNT
        }


def _state(live: Stated, smoothed: Estimate, turn_deg_s: float) -> str:
    """What the boat was doing, one of `STATES`."""
    if live.is_coasting:
        return "without fixes"
    if math.hypot(*smoothed.state[2:4]) < AT_REST_M_S:
        return "at rest"
    return "turning" if abs(turn_deg_s) > TURNS_DEG_S else "straight ahead"


def _nees(live: Stated, smoothed: Estimate) -> float:
    """Normalised error squared of the place, 2 in the mean for a doubt that is right."""
    east2, both, north2 = live.east2, live.both, live.north2
    east, north = LocalPlane(smoothed.lat_deg, smoothed.lon_deg).to_east_north_m(live.lat_deg, live.lon_deg)
    determinant = east2 * north2 - both * both
    if determinant <= 0.0:
        return math.inf
    return (north2 * east * east - 2.0 * both * east * north + east2 * north * north) / determinant


def verdict(summary: dict[str, dict[str, float | int]]) -> str:
    """The verdict in a sentence or two, for a person."""
    if not summary:
        return "its own doubt: too few estimates to judge it"
    wrong = [
        f"{part} {100.0 * figures[part]:.0f} % {state}"
        for state, figures in summary.items()
        for part in ("place", "heading")
        if figures[part] < RIGHT_FROM
    ]
    if not wrong:
        least = min(figures[part] for figures in summary.values() for part in ("place", "heading"))
        share = f"{100.0 * least:.0f} %"
        return f"its own doubt is right: at least {share} of what it stated lies within 95 % of the smoothed track"
    return (
        f"its own doubt is too small: within 95 % of the smoothed track lies {', '.join(wrong)}"
        " (sigmas of the sensors too small, or a sensor is wrong)"
    )
