"""What a trip was: time, way, area, speed, events, names."""

import dataclasses
from typing import Any

import pytest

from common.geodesy import LocalPlane
from common.messages import Fix
from common.units import NS_PER_S
from shore.logbook.summary import TripSummary
from tests.strategies import frame_of

PLANE = LocalPlane(50.0, -4.0)


def estimate(t_s: float, east_m: float, north_m: float, **other: Any) -> dict[str, Any]:
    lat_deg, lon_deg = PLANE.to_lat_lon_deg(east_m, north_m)
    t_ns = round(t_s * NS_PER_S)
    return {
        "filter": "fuzzy",
        "t_ns": t_ns,
        "lat_deg": lat_deg,
        "lon_deg": lon_deg,
        "sog_kn": 2.0,
        "aligned": True,
        "aligned_parts": ["position", "heading"],
        "heading_true_deg": 90.0,
        "position_from": "fix",
        "heading_from": "compass",
    } | other


def test_the_way_is_summed_over_seconds_of_the_first_filter_while_its_position_is_valid() -> None:
    summary = TripSummary()
    summary.estimate(estimate(0.0, 900.0, 0.0, aligned=False, aligned_parts=[], sog_kn=50.0))
    for tenth in range(101):
        wobble_m = 0.5 * (-1) ** tenth if tenth % 10 else 0.0  # within a second: noise, no way
        summary.estimate(estimate(0.1 * tenth, 3.0 * 0.1 * tenth + wobble_m, 4.0 * 0.1 * tenth))
        summary.estimate(estimate(0.1 * tenth, 0.0, 99.0 * tenth, filter="kf"))
    summary.estimate(estimate(5.0, 999.0, 0.0))  # another clock of the board: a new place, no way to it
    found = summary.as_record()
    assert found["distance_m"] == pytest.approx(50.0, abs=0.1)
    assert found["filters"] == ["fuzzy", "kf"]
    assert found["max_sog_kn"] == 2.0
    assert found["east_deg"] == pytest.approx(PLANE.to_lat_lon_deg(999.0, 0.0)[1])
    assert (found["south_deg"], found["west_deg"]) == (pytest.approx(50.0), pytest.approx(-4.0))


def test_time_is_summed_over_clocks_of_the_board_and_late_frames_add_none() -> None:
    summary = TripSummary()
    one = frame_of(Fix(sensor="gps1", t_ns=0, lat_deg=1.0, lon_deg=1.0), t0_ns=0, t1_ns=NS_PER_S)
    for clock_id, second in (("a", 10), ("a", 12), ("a", 11), ("b", 500), ("b", 501)):
        t0_ns = second * NS_PER_S
        summary.frame(dataclasses.replace(one, clock_id=clock_id, t0_ns=t0_ns, t1_ns=t0_ns + NS_PER_S))
    found = summary.as_record()
    assert (found["seconds"], found["frames"], found["fixes"]) == (5.0, 5, 5)


def test_names_are_the_last_given_ones_and_nothing_known_is_none() -> None:
    summary = TripSummary()
    assert summary.as_record()["south_deg"] is None
    connected = {"config": {"boat": {"id": "springer"}}}
    summary.session({"kind": "start", "connected": connected, "utc_ns": 7}, 1)
    summary.session({"kind": "start", "connected": connected, "utc_ns": 9}, 2)
    summary.session({"kind": "trip", "name": "first", "place": "Roadford"}, 3)
    summary.session({"kind": "trip", "name": "second"}, 4)
    for level in ("warning", "info", "warning"):
        summary.event(level)
    found = summary.as_record()
    assert [found[key] for key in ("name", "place", "note", "boat", "utc_ns")] == [
        "second",
        "Roadford",
        None,
        "springer",
        7,
    ]
    assert found["events"] == {"info": 1, "warning": 2}


def test_the_time_is_summed_by_what_position_and_heading_rest_on() -> None:
    summary = TripSummary()
    stretches: list[tuple[int, dict[str, Any]]] = [
        (10, {"aligned_parts": [], "heading_true_deg": None, "heading_from": None}),
        (20, {}),
        (40, {"position_from": "coasting"}),
        (10, {"heading_from": "course"}),
        (5, {"position_from": "coasting"}),
    ]
    second = 0
    for count, changes in stretches:
        for _ in range(count):
            second += 1
            summary.estimate(estimate(float(second), 0.0, 0.0, **changes))
            summary.estimate(estimate(float(second), 0.0, 0.0, filter="kf", position_from="coasting"))
    summary.estimate(estimate(second + 60.0, 0.0, 0.0))  # nothing is known of the minute between them
    found = summary.as_record()
    assert found["position_from_s"] == {"coasting": 45.0, "fix": 30.0, "not aligned": 9.0}
    assert found["heading_from_s"] == {"compass": 65.0, "course": 10.0, "unknown": 9.0}
    assert found["longest_coasting_s"] == 40.0


def test_estimates_of_before_say_nothing_of_it() -> None:
    summary = TripSummary()
    for second in range(5):
        summary.estimate(estimate(float(second), 0.0, 0.0, position_from=None, heading_from=None))
    found = summary.as_record()
    assert (found["position_from_s"], found["heading_from_s"], found["longest_coasting_s"]) == ({}, {}, 0.0)
