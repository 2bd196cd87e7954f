"""Sensor error tables of the thesis, as constants.

Readings of doubtful entries: numbers headed "variance" with the unit of a deviation are 1-sigma; the scanned
"0.0042 m/s^2" is 0.004 squared, so 0.004 m/s^2; table 5.4's biases are removed before the thesis' filters run.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

from common.simulation.filter_tuning import Assumed
from common.simulation.sensor_errors import Deviation, Flaws, gauss_markov
from common.simulation.sensor_models import SensorErrors

TABLE_3_2_COMPASS_DEG: Final = {"tcm2": 1.0, "hmr3000": 0.5, "kvh-c100": 0.5}
"""RMS errors of Springer's compasses, deg."""
TABLE_3_2_GPS_2D_M: Final = 5.0
"""Horizontal error of Springer's BU-353, m: "up to 5 m 2D". Read as the RMS distance: 3.5 m for each axis."""


@dataclass(frozen=True, slots=True)
class Margin:
    """One row of Table 3.3: what a cause adds to a position (m), from its least to its greatest."""

    cause: str
    least_m: float
    greatest_m: float
    is_slow: bool
    """True = the error wanders over minutes, False = it is new with each fix; this distinction is ours."""


TABLE_3_3: Final = (
    Margin("receiver clock", 3.0, 10.0, is_slow=True),
    Margin("number of satellites", 5.0, 5.0, is_slow=True),
    Margin("satellite geometry", 5.0, 5.0, is_slow=True),
    Margin("multipath", 5.0, 5.0, is_slow=False),
    Margin("ionosphere", 5.0, 10.0, is_slow=True),
    Margin("troposphere", 2.0, 2.0, is_slow=True),
)


def budget_m(*, is_slow: bool) -> float:
    """1-sigma of an axis from Table 3.3: middles of the margins, read as 95 % (2 sigma), as a root of squares.

    All rows together give 5.3 m with the least margins and 8.4 m with the greatest: Table 3.4's 8 m and 7 m.
    """
    rows = [row for row in TABLE_3_3 if row.is_slow == is_slow]
    return 0.5 * math.hypot(*(0.5 * (row.least_m + row.greatest_m) for row in rows))


TABLE_3_4: Final = SensorErrors(
    gps_east_m=8.0, gps_north_m=7.0, compass_deg=0.5, accel_density=0.004, gyro_density_deg=0.036
)
QUIET: Final = replace(TABLE_3_4, gps_east_m=3.0, gps_north_m=2.5)
"""Sensor errors that Scenarios 4.1 and 4.2 must have used: their raw MSEs of 6 to 10 m^2 rule out the 8 m and 7 m of
Table 3.4 that the text names, and fit Table 4.1."""
TABLE_4_4: Final = replace(TABLE_3_4, compass_deg=1.0, gyro_density_deg=0.033)
TABLE_5_4: Final = replace(TABLE_3_4, compass_deg=0.8)
POOR: Final = replace(TABLE_5_4, gps_east_m=20.0, gps_north_m=20.0, compass_deg=5.0)
"""Sensor errors of Scenario 5.2."""
TABLE_5_4_BIAS: Final = {"bias_accel_fwd_m_s2": 0.03, "bias_accel_stb_m_s2": 0.02, "bias_yaw_rate_deg_s": 0.28}
"""Biases for `replace(errors, **TABLE_5_4_BIAS)`; the same are in Tables 3.4 and 4.4."""

TABLE_4_1: Final = Assumed(
    gps_east_m=3.0, gps_north_m=2.5, compass_deg=0.5, accel_density=0.0039, gyro_density_deg=0.033
)
"""Tuning of the filters of chapter 4, with P(1) of Eqs 4.39 and 4.43."""
TABLE_5_3: Final = replace(TABLE_4_1, gps_east_m=6.0, gps_north_m=7.0)
"""Tuning of the filters of chapter 5. No P(1) is printed there: that of chapter 4."""


def compat(assumed: Assumed) -> Assumed:
    """The profile that explains the published figures: Q with q in the place of q^2, and a start that is exact."""
    return replace(
        assumed,
        accel_density=math.sqrt(assumed.accel_density),
        gyro_density_deg=math.sqrt(assumed.gyro_density_deg),
        exact_start=True,
    )


REALISTIC: Final = Flaws(
    turn_on=(0.03, 0.02, 0.28),
    scale=(0.01, 0.01, 0.01),
    accel_drift=gauss_markov(0.005, 600.0),
    gyro_drift_deg=gauss_markov(0.01, 600.0),
    gps_drift_m=gauss_markov(budget_m(is_slow=True), 300.0),
    deviation=Deviation(A=0.5, B=1.5, C=-1.0, D=0.5, E=0.3),
    gps_latency_s=0.2,
    compass_latency_s=0.1,
)
"""Preset `realistic` (`scenario.realistic` puts it into one). Turn-on biases have Table 3.4's values as 1-sigma, the
slow GPS error is Table 3.3's; the other sizes are ours, usual for a MEMS unit and a compass that was swung once."""
