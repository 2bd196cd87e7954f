"""The scenarios of the thesis' chapters 4 and 5, in its own order and under its numbers.

What the thesis leaves open (turn rate, clearance, directions of currents, which noise) is read as `docs/thesis-map.md`
says. Its maps are pictures on a scale of 1:5; the coast lines here are our own schematic stand-ins.
"""

from dataclasses import replace
from typing import Final

from common.simulation.fields import Uniform, WavyCurrent
from common.simulation.filter_tuning import Assumed
from common.simulation.manoeuvres import Manoeuvres, Turn
from common.simulation.motion import Mission, Place
from common.simulation.scenario import Scenario
from common.simulation.sensor_models import Phase, SensorErrors
from common.simulation.thesis_tables import POOR, QUIET, TABLE_3_4, TABLE_4_1, TABLE_4_4, TABLE_5_3, TABLE_5_4, compat

CHAPTER_4: Final = "thesis, chapter 4"
CHAPTER_5: Final = "thesis, chapter 5"

LINE: Final = Mission(start=(365.0, 728.0), waypoints=((517.0, 125.0),), heading_deg=150.0)
"""Mission of Scenario 4.3, Eq. 4.56; turn rate and clearance are not printed."""
TRACK_1: Final = Mission(
    start=(765.0, 728.0), waypoints=((650.0, 385.0), (320.0, 190.0), (30.0, 250.0)), heading_deg=210.0
)
"""Mission on track T1 of Table 4.6 and Eq. 4.57."""
TRACK_2: Final = replace(TRACK_1, waypoints=((580.0, 385.0), (380.0, 190.0), (30.0, 250.0)))
TRACK_3: Final = replace(TRACK_1, waypoints=((650.0, 200.0), (320.0, 260.0), (30.0, 250.0)))

EBB_DEG: Final = 140.0
"""Direction to which the current of Scenario 4.3 flows, deg; the thesis shows it only as a picture."""
SOLENT_TIDE: Final = WavyCurrent(drift_m_s=0.5, towards_deg=235.0, swing_deg=45.0, wavelength_m=800.0)
"""The varied current of Scenario 4.4, which the thesis shows only as a picture."""

SOUTHAMPTON_COAST: Final[tuple[Place, ...]] = (
    (215.0, 800.0), (250.0, 690.0), (235.0, 560.0), (300.0, 450.0), (290.0, 330.0), (360.0, 210.0), (345.0, 90.0),
    (420.0, 0.0),
)  # fmt: skip
SOLENT_COAST: Final[tuple[Place, ...]] = (
    (0.0, 165.0), (90.0, 140.0), (210.0, 120.0), (330.0, 85.0), (430.0, 95.0), (540.0, 60.0), (660.0, 90.0),
    (740.0, 150.0), (800.0, 140.0),
)  # fmt: skip
"""The shore of an island south of the tracks."""


def _chapter_5(name: str, text: str, *phases: Phase) -> Scenario:
    return Scenario(
        name=name,
        group=CHAPTER_5,
        text=text,
        mission=TRACK_1,
        current=SOLENT_TIDE,
        phases=phases,
        assumed=TABLE_5_3,
        compat=compat(TABLE_5_3),
        coast=SOLENT_COAST,
    )


def _practical(name: str, text: str, mission: Mission, current: Uniform | WavyCurrent) -> Scenario:
    """Section 4.3.3: the filter keeps Table 4.1 while the sensors have Table 4.4."""
    return Scenario(
        name=name,
        group=CHAPTER_4,
        text=text,
        mission=mission,
        current=current,
        phases=(Phase(0.0, TABLE_4_4),),
        assumed=TABLE_4_1,
        compat=compat(_right_r(TABLE_4_1, TABLE_4_4)),
        coast=SOUTHAMPTON_COAST if mission is LINE else SOLENT_COAST,
    )


def _right_r(assumed: Assumed, errors: SensorErrors) -> Assumed:
    """The published figures of 4.3 and 4.4 fit only a filter that knew the noise of GPS and compass."""
    return replace(
        assumed, gps_east_m=errors.gps_east_m, gps_north_m=errors.gps_north_m, compass_deg=errors.compass_deg
    )


THESIS: Final = (
    Scenario(
        name="4.0",
        group=CHAPTER_4,
        text="moored boat: its place from the mean of fixes (section 4.1.1; the number is ours)",
        mission=Manoeuvres(start=(400.0, 400.0), heading_deg=30.0, duration_s=300.0, speed_m_s=0.0),
        phases=(Phase(0.0, TABLE_3_4),),
        assumed=replace(
            TABLE_4_1, gps_east_m=8.0, gps_north_m=7.0, start_position_m=20.0, start_velocity_m_s=0.01
        ),
    ),
    Scenario(
        name="4.1",
        group=CHAPTER_4,
        text="straight line at constant velocity in still water",
        mission=Manoeuvres(start=(125.0, 628.0), heading_deg=135.0, duration_s=699.0),
        phases=(Phase(0.0, QUIET),),
        assumed=TABLE_4_1,
        compat=compat(TABLE_4_1),
    ),
    Scenario(
        name="4.2",
        group=CHAPTER_4,
        text="two turns to port of 3 deg/s in still water",
        mission=Manoeuvres(
            start=(250.0, 280.0),
            heading_deg=70.0,
            duration_s=299.0,
            turns=(Turn(114.0, 149.0, -3.0), Turn(224.0, 254.0, -3.0)),
        ),
        phases=(Phase(0.0, QUIET),),
        assumed=TABLE_4_1,
        compat=compat(TABLE_4_1),
    ),
    *(
        _practical(f"4.3-{drift:g}", f"straight line in a current of {drift:g} m/s", LINE, Uniform(drift, EBB_DEG))
        for drift in (0.5, 0.3, 0.15)
    ),
    *(
        _practical(f"4.4-T{number}", f"two turns in a varying current, track T{number} (Table 4.6)", track, SOLENT_TIDE)
        for number, track in enumerate((TRACK_1, TRACK_2, TRACK_3), start=1)
    ),
    _chapter_5("5.1", "track T1, sensors nearly as good as the filter is told", Phase(0.0, TABLE_5_4)),
    _chapter_5("5.2", "track T1, GPS noise 20 m and compass noise 5 deg: the filter is told wrong", Phase(0.0, POOR)),
    _chapter_5(
        "5.3",
        "two turns in a varying current; after 300 s the GPS noise rises to 20 m and the compass noise to 5 deg",
        Phase(0.0, TABLE_5_4),
        Phase(300.0, POOR),
    ),
)  # fmt: skip
