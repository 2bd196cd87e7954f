"""The stages of a start as events: what is awaited, started, aligned; each once."""

from dataclasses import replace

import pytest

from common.messages import Frame
from common.units import NS_PER_S
from shore.navigation.estimate import Estimate
from shore.navigation.filter_bank import Moment
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.notices import Notices
from shore.navigation.start_events import StartEvents
from shore.pipeline import Pipeline
from tests.navigate.voyages import BOAT

FIRST_S = 100


class Start:
    """One run that began at `FIRST_S`; answers with the events of each frame."""

    def __init__(self, *, has_compass: bool = True) -> None:
        self.notices = Notices()
        self.events = StartEvents(self.notices, has_compass=has_compass)

    def at(
        self, t_s: int, moment: Moment, *estimates: Estimate, waiting: tuple[str, ...] | None = None
    ) -> list[tuple[str, int, str | None]]:
        """(code, seconds, what is missing)."""
        t_ns = t_s * NS_PER_S
        moments = [moment._replace(t_ns=t_ns)]
        self.events.take(moments, estimates, waiting, first_ns=FIRST_S * NS_PER_S, newest_ns=t_ns)
        return [
            (each.code, each.t_ns // NS_PER_S, str(each.evidence["missing"]) if "missing" in each.evidence else None)
            for each in self.notices.take()
        ]


NOTHING = Moment(0, (None,))
FIX = Position(0, "gps1", 0.0, 0.0)
NORTHWARDS = TrueHeading(0, "compass1", 0.0)


@pytest.fixture
def estimate(short_voyage: list[Frame]) -> Estimate:
    (estimate,) = Pipeline(BOAT, ("kf",)).push(short_voyage[0]).estimates
    return replace(estimate, lat_deg=-36.8412345678, lon_deg=174.7)


def test_waiting_is_said_once_and_after_five_seconds() -> None:
    start = Start()
    assert start.at(FIRST_S + 4, NOTHING) == []
    assert start.at(FIRST_S + 5, NOTHING) == [("filter-waiting", FIRST_S + 5, "position, heading")]
    assert start.at(FIRST_S + 6, NOTHING) == []


@pytest.mark.parametrize(
    ("moment", "has_compass", "missing"),
    [
        (NOTHING._replace(position=FIX), True, "heading"),
        (NOTHING._replace(position=FIX), False, "heading (2 kn or more: no compass)"),
        (NOTHING._replace(heading=NORTHWARDS), True, "position"),
    ],
)
def test_it_says_what_is_missing(moment: Moment, has_compass: bool, missing: str) -> None:
    start = Start(has_compass=has_compass)
    assert start.at(FIRST_S + 9, moment) == [("filter-waiting", FIRST_S + 9, missing)]


def test_a_start_is_said_once_with_its_place_and_then_nothing_is_awaited(estimate: Estimate) -> None:
    start = Start()
    start.events.take((), (estimate,), ("IMU biases",), first_ns=0, newest_ns=estimate.t_ns)
    (told,) = start.notices.take()
    assert (told.code, told.t_ns) == ("filter-started", estimate.t_ns)
    assert told.evidence == {"lat_deg": -36.841235, "lon_deg": 174.7}
    assert start.at(FIRST_S + 9, NOTHING, estimate, waiting=("IMU biases",)) == []


def test_aligned_is_said_once_when_nothing_is_lacking_any_more(estimate: Estimate) -> None:
    start = Start()
    told = [
        start.at(FIRST_S + second, NOTHING, estimate, waiting=waiting)
        for second, waiting in enumerate((("heading",), None, (), ("heading",), ()))
    ]
    assert [code for code, _, _ in told[0]] == ["filter-started"]
    assert told[1:] == [[], [("filter-aligned", FIRST_S + 2, None)], [], []]
