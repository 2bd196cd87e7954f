"""Scenarios of our own: what the thesis tried on a lake, and where its filters meet their limits."""

from dataclasses import replace
from typing import Final

from common.geodesy import LocalPlane
from common.simulation.fields import SOUTHAMPTON_WATER, Leeway, Sum, Tide, Uniform
from common.simulation.filter_tuning import Assumed
from common.simulation.motion import Mission, Place
from common.simulation.scenario import Outage, Scenario, with_bias
from common.simulation.scenarios_thesis import SOLENT_COAST, SOLENT_TIDE, TRACK_1
from common.simulation.sensor_models import Phase, SensorErrors
from common.simulation.thesis_tables import POOR, TABLE_5_3, TABLE_5_4

OURS: Final = "ours"


def told_right(errors: SensorErrors) -> Assumed:
    """A filter that knows the noise."""
    return replace(
        TABLE_5_3,
        gps_east_m=errors.gps_east_m,
        gps_north_m=errors.gps_north_m,
        compass_deg=errors.compass_deg,
        accel_density=errors.accel_density,
        gyro_density_deg=errors.gyro_density_deg,
    )


def _degrees(ddmm: float) -> float:
    """ddmm.mmmm of Table 5.9 -> degrees."""
    whole, minutes = divmod(abs(ddmm), 100.0)
    return (whole + minutes / 60.0) * (1.0 if ddmm >= 0.0 else -1.0)


ROADFORD: Final = LocalPlane(_degrees(5041.7226), _degrees(-414.1994))
"""Local plane about the start point of Table 5.9."""
BUOYS: Final = tuple(
    ROADFORD.to_east_north_m(_degrees(lat), _degrees(lon))
    for lat, lon in ((5041.8085, -414.0430), (5041.9728, -413.9645), (5041.9330, -414.1790))
)
"""Buoys of Table 5.9, east and north, m. The metres printed there omit cos(lat), so their eastings are 1.58 times too
long."""
ROADFORD_COAST: Final[tuple[Place, ...]] = (
    (-60.0, -50.0), (60.0, -35.0), (170.0, 60.0), (270.0, 140.0), (330.0, 300.0), (340.0, 480.0), (260.0, 560.0),
    (120.0, 500.0), (-40.0, 470.0), (-80.0, 330.0), (-20.0, 180.0), (-60.0, -50.0),
)  # fmt: skip

ESTUARY: Final = Tide(flood_towards_deg=315.0, slack_s=-28_000.0, peaks=SOUTHAMPTON_WATER, mouth=(900.0, 0.0))
"""Ebb, some 1.5 hours after slack water: it grows with time, and down the estuary fourfold."""
ESTUARY_COAST: Final[tuple[Place, ...]] = (
    (-300.0, 1020.0), (-150.0, 880.0), (0.0, 760.0), (110.0, 610.0), (270.0, 470.0), (400.0, 310.0), (560.0, 170.0),
    (680.0, 20.0), (820.0, -120.0),
)  # fmt: skip

CALIBRATED: Final = replace(TABLE_5_4, compass_deg=1.0)
"""Sensor errors of a calibrated boat: GPS 8 m and 7 m, compass 1 deg."""
SHAKEN: Final = replace(
    TABLE_5_4, accel_density=5.0 * TABLE_5_4.accel_density, gyro_density_deg=5.0 * TABLE_5_4.gyro_density_deg
)
"""Sensor errors with an IMU noise five times as large."""
NIMBLE: Final = replace(TABLE_5_4, compass_deg=20.0)


def _on_track_1(name: str, text: str, *phases: Phase) -> Scenario:
    return Scenario(
        name=name,
        group=OURS,
        text=text,
        mission=TRACK_1,
        current=SOLENT_TIDE,
        phases=phases,
        assumed=told_right(phases[0].errors),
        coast=SOLENT_COAST,
    )


OWN: Final = (
    Scenario(
        name="roadford",
        group=OURS,
        text="a simulation of the lake trial (section 5.3): buoys of Table 5.9, sailed round for 20 min at 1.5 m/s; "
        "current to the north-west, wind from the east; GPS noise 20 m and compass noise 5 deg against Table 5.3",
        mission=Mission(
            start=(0.0, 0.0),
            waypoints=BUOYS * 3,
            heading_deg=49.0,
            speed_m_s=1.5,
            turn_rate_deg_s=6.0,
            longest_s=1200.0,
        ),
        current=Sum((Uniform(0.2, 315.0), Leeway(Uniform(2.1, 270.0), 0.03))),
        phases=(Phase(0.0, POOR),),
        assumed=TABLE_5_3,
        plane=ROADFORD,
        coast=ROADFORD_COAST,
    ),
    Scenario(
        name="agile",
        group=OURS,
        text="a slalom at 4 m/s and 15 deg/s, compass noise 20 deg: on a poorly known heading the KF falls behind",
        mission=Mission(
            start=(50.0, 100.0),
            waypoints=tuple((50.0 + 35.0 * (leg % 2), 100.0 + 35.0 * leg) for leg in range(1, 31)),
            heading_deg=45.0,
            speed_m_s=4.0,
            turn_rate_deg_s=15.0,
        ),
        phases=(Phase(0.0, NIMBLE),),
        assumed=replace(told_right(NIMBLE), start_heading_deg=30.0),
    ),
    with_bias(
        _on_track_1(
            "uncalibrated", "track T1, the full IMU bias of Table 5.4 left in, noise as told", Phase(0.0, CALIBRATED)
        )
    ),
    _on_track_1(
        "imu-noise",
        "track T1; after 300 s the IMU noise is five times as large, GPS and compass stay as told",
        Phase(0.0, TABLE_5_4),
        Phase(300.0, SHAKEN),
    ),
    _on_track_1(
        "imu-and-gps-noise",
        "track T1; after 300 s the IMU noise is five times as large, GPS noise 20 m and compass noise 5 deg",
        Phase(0.0, TABLE_5_4),
        Phase(300.0, replace(POOR, accel_density=SHAKEN.accel_density, gyro_density_deg=SHAKEN.gyro_density_deg)),
    ),
    Scenario(
        name="tidal-outage",
        group=OURS,
        text="down an estuary on the ebb, without GPS for 8 min from 300 s on while the current grows threefold",
        mission=Mission(
            start=(-220.0, 1150.0),
            waypoints=((150.0, 720.0), (420.0, 520.0), (700.0, 180.0), (1000.0, -60.0), (1200.0, -280.0)),
            heading_deg=135.0,
            speed_m_s=1.5,
            turn_rate_deg_s=6.0,
        ),
        current=ESTUARY,
        phases=(Phase(0.0, CALIBRATED),),
        assumed=told_right(CALIBRATED),
        outages=(Outage("gps1", 300.0, 480.0),),
        coast=ESTUARY_COAST,
    ),
)  # fmt: skip
