"""What an estimate rests on: fix or dead reckoning, compass or course; said once, and not for a hole of the link."""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

import pytest

from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.geodesy import LocalPlane
from common.messages import Event, Fix, Frame, Heading
from common.units import M_S_PER_KN, NS_PER_S
from shore.navigation.estimate import MOST_DOUBT_M, Estimate
from shore.pipeline import Pipeline
from tests.strategies import frame_of

HOME = LocalPlane(42.23, -8.74)
GPS = SensorTable(id="gps1", port="p", role="gps", rate_hz=1.0)
COMPASS = SensorTable(id="compass1", port="p", role="compass", rate_hz=1.0)


def boat(*sensors: SensorTable, leeway_m_s: float = 0.1) -> BoatConfig:
    return BoatConfig(
        boat=BoatTable(id="b", leeway_m_s=leeway_m_s), port=(PortTable(name="p", path="x"),), sensor=sensors
    )


def sailed(second: int, knots: float = 5.0, *, compass: bool = True, sensor: str = "gps1") -> Frame:
    """The frame of one second of a boat that goes east from `HOME`."""
    t_ns = second * NS_PER_S
    lat_deg, lon_deg = HOME.to_lat_lon_deg(knots * M_S_PER_KN * second, 0.0)
    fix = Fix(
        sensor=sensor, t_ns=t_ns, lat_deg=lat_deg, lon_deg=lon_deg, fix_quality=1, sog_kn=knots, cog_true_deg=90.0
    )
    heading = (Heading(sensor="compass1", t_ns=t_ns, heading_true_deg=90.0),) if compass else ()
    times = {"seq": second, "t0_ns": t_ns - NS_PER_S // 2, "t1_ns": t_ns + NS_PER_S // 2}
    return frame_of(fix, *heading, start_no=0, **times)


def without_fix(frame: Frame) -> Frame:
    return replace(frame, fixes=())


def void(frame: Frame) -> Frame:
    """The receiver says that it has no fix."""
    (fix,) = frame.fixes
    return replace(frame, fixes=(replace(fix, lat_deg=None, lon_deg=None, fix_quality=0, sog_kn=None),))


Change = Callable[[Frame], Frame]


def play(config: BoatConfig, frames: Iterable[Frame]) -> tuple[dict[int, Estimate], list[Event]]:
    """Estimates by the number of their frame, and the events."""
    pipeline = Pipeline(config, ("ukf",))
    outputs = [pipeline.push(frame) for frame in frames]
    estimates = {each.seq: each for output in outputs for each in output.estimates}
    return estimates, [told for output in outputs for told in output.events]


def outage(change: Change, first: int = 30, last: int = 59) -> list[Frame]:
    return [change(sailed(second)) if first <= second <= last else sailed(second) for second in range(1, 81)]


def codes(events: Iterable[Event], *kinds: str) -> list[str]:
    return [told.code for told in events if told.code.startswith(kinds)]


def test_a_void_fix_makes_the_next_estimate_a_dead_reckoning() -> None:
    estimates, events = play(boat(GPS, COMPASS), outage(void))
    assert [second for second, each in estimates.items() if each.position_from == "coasting"] == list(range(30, 60))
    assert {each.position_since_ns for each in estimates.values() if each.position_from == "coasting"} == {
        29 * NS_PER_S
    }
    assert estimates[29].position_since_ns == NS_PER_S
    assert estimates[60].position_since_ns == 60 * NS_PER_S
    lost, regained = (told for told in events if told.code.startswith("fix-"))
    assert (lost.code, lost.level, lost.t_ns // NS_PER_S, lost.evidence["seconds"]) == ("fix-lost", "warning", 34, 5.5)
    assert (regained.code, regained.t_ns // NS_PER_S) == ("fix-regained", 60)
    assert regained.evidence["seconds"] == 31.0


def test_a_loss_that_a_late_fix_ends_lasted_for_some_seconds() -> None:
    """The next fix is stamped 5.0 s after the last one, before the loss was noticed: the row of fixes is unbroken."""

    def late(frame: Frame) -> Frame:
        return replace(frame, fixes=tuple(replace(fix, t_ns=fix.t_ns - 700_000_000) for fix in frame.fixes))

    _, events = play(boat(GPS, COMPASS), map(late, outage(without_fix, 30, 33)))
    lost, regained = (told for told in events if told.code.startswith("fix-"))
    assert (lost.code, regained.code) == ("fix-lost", "fix-regained")
    assert 5.0 <= float(str(regained.evidence["seconds"])) <= 6.5


def test_a_silent_receiver_is_waited_for_five_periods() -> None:
    estimates, events = play(boat(GPS, COMPASS), outage(without_fix))
    assert [second for second, each in estimates.items() if each.position_from == "coasting"] == list(range(34, 60))
    assert codes(events, "fix-") == ["fix-lost", "fix-regained"]


def test_a_position_that_the_receiver_repeats_is_as_good_as_silence() -> None:
    held = partial(replace, fixes=(replace(sailed(29).fixes[0], t_ns=31 * NS_PER_S, held=True),))
    estimates, _ = play(boat(GPS, COMPASS), outage(held, 30, 31))
    assert {each.position_from for each in estimates.values()} == {"fix"}
    estimates, _ = play(boat(GPS, COMPASS), outage(held))
    assert [second for second, each in estimates.items() if each.position_from == "coasting"] == list(range(34, 60))


def test_a_fix_that_comes_and_goes_is_no_event() -> None:
    frames = [void(sailed(second)) if second % 2 else sailed(second) for second in range(2, 60)]
    estimates, events = play(boat(GPS, COMPASS), frames)
    assert {each.position_from for each in estimates.values()} == {"fix", "coasting"}
    assert codes(events, "fix-") == []


def test_the_other_receiver_carries_on() -> None:
    """The one that is lost says so each second; the estimate rests on the other one."""
    frames = []
    for second in range(1, 60):
        first, other = sailed(second), sailed(second, sensor="gps2")
        first = void(first) if second > 30 else first
        later = tuple(replace(fix, t_ns=fix.t_ns + NS_PER_S // 5) for fix in first.fixes)
        frames.append(replace(first, fixes=(*other.fixes, *later)))
    estimates, events = play(boat(GPS, replace(GPS, id="gps2"), COMPASS), frames)
    assert {each.position_from for each in estimates.values()} == {"fix"}
    assert codes(events, "fix-") == []


def test_a_hole_of_the_link_is_no_loss_of_the_fix() -> None:
    """The first frame behind it has no fix: its estimate is dead reckoning, and nobody says that a fix was lost."""
    frames = [sailed(second) for second in range(1, 81) if not 30 <= second <= 59]
    frames[29] = without_fix(frames[29])
    estimates, events = play(boat(GPS, COMPASS), frames)
    assert (estimates[60].position_from, estimates[60].position_since_ns) == ("coasting", 29 * NS_PER_S)
    assert estimates[61].position_from == "fix"
    assert codes(events, "fix-") == []


def test_a_late_frame_is_put_in_its_place() -> None:
    """What the newest estimate rests on does not depend on the order of arrival."""
    frames = [sailed(second) for second in range(1, 20)]
    in_order, _ = play(boat(GPS, COMPASS), frames)
    late, _ = play(boat(GPS, COMPASS), [*frames[:9], *frames[10:13], frames[9], *frames[13:]])
    assert late[19].position_since_ns == in_order[19].position_since_ns == NS_PER_S
    assert late[19].position_from == in_order[19].position_from == "fix"


def test_without_a_heading_position_and_speed_are_valid() -> None:
    """1.2 kn: no course shows the heading, so there is none, and it is said once."""
    frames = [sailed(second, 1.2, compass=False) for second in range(1, 61)]
    estimates, events = play(boat(GPS), frames)
    last = estimates[60]
    assert (last.heading_true_deg, last.heading_from) == (None, None)
    assert (last.aligned, last.aligned_parts) == (False, ("position",))
    assert math.isfinite(last.state[last.names.index("heading_rad")])
    east_m, north_m = HOME.to_east_north_m(last.lat_deg, last.lon_deg)
    assert math.hypot(east_m - 1.2 * M_S_PER_KN * 60.5, north_m) < 3.0
    assert last.sog_kn == pytest.approx(1.2, abs=0.5)
    assert codes(events, "heading-") == ["heading-unknown"]


def test_a_course_taken_as_heading_is_said_and_holds_current_and_leeway() -> None:
    """5 kn, then 1.2 kn: the heading comes from the course, with the doubt of a current of 0.5 m/s at least."""
    frames = [sailed(second, 5.0, compass=False) for second in range(1, 61)]
    estimates, events = play(boat(GPS), frames)
    last = estimates[60]
    assert last.heading_from == "course"
    assert last.heading_true_deg == pytest.approx(90.0, abs=3.0)
    assert 0.8 * math.degrees(math.atan(0.5 / (5.0 * M_S_PER_KN))) < last.sigma_heading_deg < 30.0
    assert last.aligned_parts == ("position",)
    assert codes(events, "heading-") == ["heading-from-course"]
    (told,) = (each for each in events if each.code == "heading-from-course")
    assert told.evidence["sigma_deg"] == round(estimates[told.t_ns // NS_PER_S].sigma_heading_deg)


def test_a_compass_that_falls_silent_and_comes_back() -> None:
    frames = [sailed(second, compass=not 30 <= second <= 59) for second in range(1, 81)]
    estimates, events = play(boat(GPS, COMPASS), frames)
    assert [estimates[second].heading_from for second in (29, 33, 34, 59, 60)] == [
        "compass", "compass", "course", "course", "compass",
    ]  # fmt: skip
    assert codes(events, "heading-") == ["heading-from-course", "heading-from-compass"]
    carried, _ = play(boat(GPS, COMPASS, leeway_m_s=0.0), frames)
    assert carried[50].heading_from == "coasting"


def test_a_position_of_too_much_doubt_is_not_valid() -> None:
    """An hour without a fix."""
    frames = [sailed(second) for second in range(1, 31)]
    frames += [replace(without_fix(sailed(second)), headings=()) for second in range(31, 3631, 20)]
    estimates, _ = play(boat(GPS, COMPASS), frames)
    last = max(estimates.values(), key=lambda each: each.t_ns)
    sigmas_m = {each.seq: math.hypot(each.sigma_east_m, each.sigma_north_m) for each in estimates.values()}
    assert sigmas_m[last.seq] > MOST_DOUBT_M
    assert last.aligned_parts == ()
    for each in estimates.values():
        if each.seq > 20:
            assert ("position" in each.aligned_parts) == (sigmas_m[each.seq] <= MOST_DOUBT_M)


def test_another_quality_is_said() -> None:
    frames = [sailed(second) for second in range(1, 40)]
    frames[20:] = [replace(each, fixes=(replace(each.fixes[0], fix_quality=4),)) for each in frames[20:]]
    _, events = play(boat(GPS, COMPASS), frames)
    (told,) = (each for each in events if each.code == "fix-quality-changed")
    assert told.evidence == {"sensor": "gps1", "before": "single", "now": "RTK fixed"}
