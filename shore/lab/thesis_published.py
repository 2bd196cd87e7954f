"""The mean squared errors that the thesis prints, in our names: scenario -> method -> (east, north, heading).

`raw` stands for the sensors themselves (GPS east, GPS north, compass). The thesis' "KF" is our `kf`, its "UKF" and
"conventional UKF" our `ukf`, its "adaptive UKF" our `fuzzy-thesis`. Each number is one run.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple


class Mse(NamedTuple):
    """Mean squared errors of one row of a table."""

    east_m2: float
    north_m2: float
    heading_deg2: float


@dataclass(frozen=True, slots=True)
class Published:
    """One table's column or columns about one scenario."""

    table: str
    rows: Mapping[str, Mse]
    """Published mean squared errors, by method."""
    remark: str = ""
    """A remark on what is odd about the numbers themselves; empty = nothing."""


PUBLISHED: Final[Mapping[str, Published]] = {
    "4.1": Published(
        "4.2",
        {"raw": Mse(6.1069, 5.8936, 0.4145), "kf": Mse(0.4846, 0.5703, 0.0361)},
        "GPS east and compass do not have the noise of Table 4.1 (9 m² and 0.25 deg² expected).",
    ),
    "4.2": Published("4.3", {"raw": Mse(10.1532, 5.4936, 0.2643), "kf": Mse(1.5635, 0.8454, 0.1365)}),
    "4.3-0.5": Published("4.5", {"raw": Mse(66.6812, 51.0834, 0.9261), "ukf": Mse(4.972, 4.4747, 0.1109)}),
    "4.3-0.3": Published("4.5", {"raw": Mse(56.5433, 48.0087, 0.9469), "ukf": Mse(4.746, 4.2782, 0.0926)}),
    "4.3-0.15": Published("4.5", {"raw": Mse(63.4131, 48.4819, 1.0015), "ukf": Mse(3.8618, 3.7013, 0.0892)}),
    "4.4-T1": Published("4.7", {"raw": Mse(60.1971, 46.8124, 0.9799), "ukf": Mse(5.1926, 3.7565, 0.0956)}),
    "4.4-T2": Published("4.7", {"raw": Mse(63.1284, 47.041, 0.9473), "ukf": Mse(5.7334, 4.8809, 0.0863)}),
    "4.4-T3": Published("4.7", {"raw": Mse(64.2108, 46.8535, 0.9822), "ukf": Mse(3.2977, 3.7728, 0.0876)}),
    "5.1": Published(
        "5.5",
        {
            "raw": Mse(61.0478, 50.1697, 1.1112),
            "ukf": Mse(4.6139, 2.7207, 0.1054),
            "fuzzy-thesis": Mse(4.0837, 2.5523, 0.0011),
        },
        "The adaptive heading of 0.0011 deg² lies below the bound: no filter can reach it. The text quotes 0.4989 and "
        "0.2288 m² for the adaptive position. The compass row does not have the noise of Table 5.4 (0.64 deg²).",
    ),
    "5.2": Published(
        "5.6",
        {
            "raw": Mse(402.2386, 395.6904, 20.1516),
            "ukf": Mse(62.8698, 47.0732, 3.2428),
            "fuzzy-thesis": Mse(26.6514, 18.0436, 0.6988),
        },
        "The compass row fits a noise of 4.5 deg, not of 5 deg.",
    ),
    "5.3": Published(
        "5.7",
        {
            "raw": Mse(413.2008, 387.5966, 19.7812),
            "ukf": Mse(28.5974, 22.5572, 1.8318),
            "fuzzy-thesis": Mse(12.3998, 11.1658, 0.5234),
        },
        "The raw rows fit the steps after the change only (all steps would give about 257 and 250 m²), the filters' "
        "rows the whole run. z of the raw rows is taken after the change.",
    ),
}
"""Published results, by scenario."""

RAW_AFTER_CHANGE: Final = ("5.3",)
"""Scenarios whose raw row covers only the steps after the change."""

US_PER_STEP: Final = {"simulation": 2300.0, "trial": 1700.0}
"""Processor time of one step as the thesis quotes it (sections 5.2.3 and 5.3.2), us."""
