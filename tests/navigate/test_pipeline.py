"""The pipeline: frames in, estimates and events out, the same every time."""

import json
import math
from collections.abc import Iterable
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from common.boat_config import BoatTable
from common.errors import WayfixError
from common.messages import Event, Fix, Frame, Heading
from common.simulation.scenarios import scenario_voyage
from shore.navigation.estimate import Estimate
from shore.navigation.measurements import Position, Reader
from shore.navigation.state_space import HEADING
from shore.pipeline import Pipeline
from tests.navigate.voyages import BOAT, HOME, sail
from tests.offline import frames_of as offline_frames
from tests.strategies import numbered_frame

FILTERS = ("fuzzy", "ukf", "kf", "fuzzy-thesis")


def play(pipeline: Pipeline, frames: Iterable[Frame]) -> tuple[list[Estimate], list[Event]]:
    outputs = [pipeline.push(frame) for frame in frames]
    estimates = [estimate for output in outputs for estimate in output.estimates]
    return estimates, [told for output in outputs for told in output.events]


def test_one_estimate_for_each_filter_and_frame_close_to_the_truth(short_voyage: list[Frame]) -> None:
    estimates, events = play(Pipeline(BOAT, FILTERS), short_voyage)
    truth = sail(62, 0.05)
    assert [estimate.filter for estimate in estimates[:4]] == list(FILTERS)
    assert len(estimates) == 4 * len(short_voyage)
    assert [told.code for told in events] == ["filter-started", "filter-aligned"]
    for estimate in estimates[-4:]:
        k = estimate.seq * 2 + 2
        east, north = HOME.to_east_north_m(estimate.lat_deg, estimate.lon_deg)
        assert math.dist((east, north), truth.states[k, :2]) < 4.0 * 8.0 / math.sqrt(20.0)
        heading = math.degrees(truth.states[k, 4])
        assert estimate.heading_true_deg is not None
        assert abs(math.remainder(estimate.heading_true_deg - heading, 360.0)) < 1.0
        assert estimate.sog_kn == pytest.approx(np.hypot(*truth.states[k, 2:4]) * 3600 / 1852, abs=0.6)
        assert estimate.aligned


def test_the_same_frames_give_the_same_records(short_voyage: list[Frame]) -> None:
    mixed = [short_voyage[i ^ 1] for i in range(200)]
    first, second = (play(Pipeline(BOAT, FILTERS), mixed) for _ in range(2))
    assert [e.as_record() for e in first[0]] == [e.as_record() for e in second[0]]
    assert first[1] == second[1]


def test_frames_out_of_order_publish_only_the_newest_and_end_the_same(short_voyage: list[Frame]) -> None:
    frames = short_voyage[:200]
    rng = np.random.default_rng(3)
    order = sorted(range(1, 200), key=lambda i: i + rng.uniform(0.0, 20.0))
    shuffled, events = play(Pipeline(BOAT, ("fuzzy",)), [frames[0], *(frames[i] for i in order)])
    straight, _ = play(Pipeline(BOAT, ("fuzzy",)), frames)
    times = [estimate.t_ns for estimate in shuffled]
    assert times == sorted(set(times))
    assert len(times) < len(straight)
    assert not [told for told in events if told.code == "late-dropped"]
    tail = play_on(frames, order, short_voyage[200])
    assert np.allclose(tail[0].state, tail[1].state, rtol=0, atol=1e-9)
    assert np.allclose(tail[0].covariance, tail[1].covariance, rtol=0, atol=1e-9)


def play_on(frames: list[Frame], order: list[int], following: Frame) -> list[Estimate]:
    """The estimate after one more frame, for both orders of arrival."""
    ends = []
    for indices in (range(1, 200), order):
        pipeline = Pipeline(BOAT, ("fuzzy",))
        play(pipeline, [frames[0], *(frames[i] for i in indices)])
        ends.append(pipeline.push(following).estimates[0])
    return ends


def test_records_are_plain_json(short_voyage: list[Frame]) -> None:
    estimates, _ = play(Pipeline(BOAT, ("fuzzy",)), short_voyage[:60])
    record = estimates[-1].as_record()
    assert list(record) == list(asdict(estimates[-1]))
    assert record["channels"] == asdict(estimates[-1])["channels"]
    assert json.loads(json.dumps(record, allow_nan=False)) == record

    def leaves(value: Any) -> list[Any]:
        if isinstance(value, dict):
            return [leaf for each in value.values() for leaf in leaves(each)]
        return [leaf for each in value for leaf in leaves(each)] if isinstance(value, list) else [value]

    assert {type(leaf) for leaf in leaves(record)} <= {int, float, str, bool, type(None)}
    assert len(record["covariance"]) == 28
    assert set(record["channels"]) == {"gps1.east", "gps1.north", "compass1.heading"}
    assert record["channels"]["compass1.heading"]["dom_ratio"] is not None


def test_known_frames_are_ignored(short_voyage: list[Frame]) -> None:
    twice = [frame for frame in short_voyage[:50] for _ in range(2)]
    once, _ = play(Pipeline(BOAT, ("fuzzy",)), short_voyage[:50])
    again, _ = play(Pipeline(BOAT, ("fuzzy",)), twice)
    assert once == again


def test_merged_frames_give_the_same_end(short_voyage: list[Frame]) -> None:
    """Two board frames in one, as `run` with a period sends them."""
    pairs = [(short_voyage[i], short_voyage[i + 1]) for i in range(0, 100, 2)]
    merged = [
        replace(
            b, first_seq=a.seq, t0_ns=a.t0_ns, fixes=a.fixes + b.fixes, headings=a.headings + b.headings,
            imu=(replace(
                b.imu[0], t_ns=a.imu[0].t_ns, offset_us=(0, 50_000, 100_000, 150_000),
                accel_fwd_m_s2=a.imu[0].accel_fwd_m_s2 + b.imu[0].accel_fwd_m_s2,
                accel_stb_m_s2=a.imu[0].accel_stb_m_s2 + b.imu[0].accel_stb_m_s2,
                yaw_rate_deg_s=a.imu[0].yaw_rate_deg_s + b.imu[0].yaw_rate_deg_s,
            ),),
        )
        for a, b in pairs
    ]  # fmt: skip
    single, _ = play(Pipeline(BOAT, ("fuzzy",)), short_voyage[:100])
    double, _ = play(Pipeline(BOAT, ("fuzzy",)), merged)
    assert np.allclose(single[-1].state, double[-1].state, atol=1e-6)


def test_missing_frames_are_bridged_by_the_running_sums(short_voyage: list[Frame]) -> None:
    """2 s of frames lost: the gap costs the compass, not the motion."""
    with_gap = [frame for frame in short_voyage if not 300 <= frame.seq < 320]
    whole, _ = play(Pipeline(BOAT, ("ukf",)), short_voyage[:322])
    broken, _ = play(Pipeline(BOAT, ("ukf",)), [frame for frame in with_gap if frame.seq < 322])
    assert abs(math.degrees(whole[-1].state[HEADING] - broken[-1].state[HEADING])) < 0.5
    assert broken[-1].state[2:4] == pytest.approx(whole[-1].state[2:4], abs=0.3)
    assert broken[-1].sigma_heading_deg < 0.5


def test_backfill_later_than_five_seconds_is_told_in_sums(short_voyage: list[Frame]) -> None:
    frames = [*short_voyage[:100], *short_voyage[200:300], *short_voyage[100:200]]
    pipeline = Pipeline(BOAT, ("fuzzy",))
    estimates, events = play(pipeline, frames)
    events += play(pipeline, short_voyage[300:450])[1]
    late = [told for told in events if told.code == "late-dropped"]
    assert {told.source for told in late} == {"gps1", "compass1", "imu1"}
    assert estimates[-1].t_ns == frames[199].t1_ns
    assert len(late) == 6
    assert sum(int(told.evidence["count"] or 0) for told in late) == 100 + 100 + 10


def test_stamps_ahead_of_their_frame_are_told_in_sums(short_voyage: list[Frame]) -> None:
    frames = [
        replace(f, headings=tuple(replace(h, t_ns=h.t_ns + 2 * 10**9) for h in f.headings) if f.seq % 2 else f.headings)
        for f in short_voyage[:250]
    ]
    for step_s in (None, 1.0):
        _, events = play(Pipeline(BOAT, ("kf",), step_s), frames)
        ahead = [told for told in events if told.code == "ahead-dropped"]
        assert [told.evidence["count"] for told in ahead] == [1, 50, 50]
        assert {told.source for told in ahead} == {"compass1"}


def test_waiting_is_told_once_and_the_start_after_it(short_voyage: list[Frame]) -> None:
    frames = [replace(frame, fixes=()) for frame in short_voyage[:80]] + short_voyage[80:220]
    estimates, events = play(Pipeline(BOAT, ("fuzzy",)), frames)
    assert [told.code for told in events] == ["filter-waiting", "filter-started", "filter-aligned"]
    assert events[0].evidence["missing"] == "position"
    assert estimates[0].seq == 80


@pytest.mark.parametrize(
    "change",
    [
        {"held": True},
        {"fix_quality": 0},
        {"fix_quality": 6},
        {"status_valid": False},
        {"lat_deg": None},
        {"fix_mode": 1},
    ],
)
def test_unusable_fixes_start_nothing(short_voyage: list[Frame], change: dict[str, Any]) -> None:
    frames = [replace(f, fixes=tuple(replace(fix, **change) for fix in f.fixes)) for f in short_voyage[:20]]
    assert play(Pipeline(BOAT, ("fuzzy",)), frames)[0] == []


def test_a_far_fix_is_told_once_and_not_used(short_voyage: list[Frame]) -> None:
    frames = list(short_voyage[:60])
    for seq in (20, 30):
        far = replace(frames[seq].fixes[0], lat_deg=51.4)
        frames[seq] = replace(frames[seq], fixes=(far,))
    estimates, events = play(Pipeline(BOAT, ("fuzzy",)), frames)
    assert [told.code for told in events].count("fix-far") == 1
    assert abs(estimates[-1].lat_deg - 50.4) < 0.01


def test_a_restart_of_the_daemon_carries_on_and_a_reboot_starts_again(short_voyage: list[Frame]) -> None:
    pipeline = Pipeline(BOAT, ("fuzzy",))
    play(pipeline, short_voyage[:30])
    daemon = [replace(f, boot_id="b2", start_no=2, seq=f.seq - 30) for f in short_voyage[30:40]]
    estimates, events = play(pipeline, daemon)
    assert len(estimates) == 10
    assert [told.code for told in events] == ["daemon-restarted"]
    reboot = [replace(f, boot_id="b3", clock_id="c2", start_no=3, seq=f.seq - 50) for f in short_voyage[50:200]]
    estimates, events = play(pipeline, reboot)
    assert [told.code for told in events] == ["board-rebooted", "filter-started", "filter-aligned"]
    assert estimates[0].seq == 0
    assert play(pipeline, [short_voyage[45]]) == ([], [])


def test_synchronous_mode_publishes_every_step(short_voyage: list[Frame]) -> None:
    estimates, _ = play(Pipeline(BOAT, ("ukf",), step_s=1.0), short_voyage[:301])
    assert len(estimates) == 31
    assert np.diff([estimate.t_ns for estimate in estimates]).tolist() == [10**9] * 30
    free, _ = play(Pipeline(BOAT, ("ukf",)), short_voyage[:301])
    assert estimates[-1].state[:2] == pytest.approx(free[-1].state[:2], abs=6.0)


@pytest.mark.parametrize(("filters", "step_s"), [((), None), (("pf",), None), (("kf",), 0.0)])
def test_wrong_requests_are_refused_at_once(filters: tuple[str, ...], step_s: float | None) -> None:
    with pytest.raises(WayfixError):
        Pipeline(BOAT, filters, step_s)


@pytest.mark.parametrize(
    ("heading", "expected_deg"),
    [
        ({"heading_true_deg": 10.0}, 10.0),
        ({"heading_mag_deg": 10.0, "variation_deg": -4.0}, 13.0),
        ({"heading_mag_deg": 10.0}, 13.0),
        ({"heading_mag_deg": 10.0, "deviation_deg": 2.0}, 15.0),
    ],
)
def test_compass_to_true_is_plus_deviation_plus_variation(heading: dict[str, Any], expected_deg: float) -> None:
    reader = Reader(replace(BOAT, boat=BoatTable(id="b", variation_deg=3.0)), lambda told: None)
    true = reader.true_heading(Heading(sensor="compass1", t_ns=0, **heading))
    assert true is not None
    assert math.degrees(true.heading_rad) == pytest.approx(expected_deg)


def test_the_boats_own_deviation_goes_before_the_devices() -> None:
    sensors = tuple(replace(s, deviation_deg=-5.0) if s.role == "compass" else s for s in BOAT.sensor)
    reader = Reader(replace(BOAT, sensor=sensors), lambda told: None)
    heading = Heading(sensor="compass1", t_ns=0, heading_mag_deg=2.0, deviation_deg=1.0)
    true = reader.true_heading(heading)
    assert true is not None
    assert math.degrees(true.heading_rad) == pytest.approx(-3.0)
    for none, expected_deg in (
        (tuple(replace(s, deviation_deg=0.0) if s.role == "compass" else s for s in BOAT.sensor), 2.0),
        # A log of before: 0 at every sensor is no statement.
        (tuple(replace(s, deviation_deg=0.0) for s in BOAT.sensor), 3.0),
    ):
        true = Reader(replace(BOAT, sensor=none), lambda told: None).true_heading(heading)
        assert true is not None
        assert math.degrees(true.heading_rad) == pytest.approx(expected_deg)


def test_sensors_that_are_not_configured_are_not_fused() -> None:
    told: list[Event] = []
    reader = Reader(BOAT, told.append)
    assert reader.position(Fix(sensor="gps9", t_ns=0, lat_deg=1.0, lon_deg=1.0)) is None
    assert reader.true_heading(Heading(sensor="compass9", t_ns=0, heading_true_deg=1.0)) is None
    assert not told


def test_velocity_and_course_only_from_speeds_that_carry_them() -> None:
    def read(sog_kn: float) -> Position:
        reader = Reader(BOAT, lambda told: None)
        fix = Fix(sensor="gps1", t_ns=0, lat_deg=1.0, lon_deg=1.0, sog_kn=sog_kn, cog_true_deg=90.0)
        position = reader.position(fix)
        assert position is not None
        return position

    assert not read(0.9).is_moving
    assert read(1.0).is_moving
    assert read(1.0).velocity_m_s == pytest.approx((1852 / 3600, 0.0))
    assert read(1.9).course_rad is None
    assert read(2.0).course_rad == pytest.approx(math.pi / 2)


def test_an_empty_frame_is_a_frame() -> None:
    frame = numbered_frame(0)
    output = Pipeline(BOAT, ("fuzzy",)).push(frame)
    assert (output.estimates, output.events) == ((), ())


def test_a_wrong_first_fix_is_left_after_ten_good_ones() -> None:
    voyage = scenario_voyage("5.3", seconds=40)
    frames = offline_frames(voyage)
    number = next(index for index, frame in enumerate(frames) if frame.fixes)
    wrong = replace(frames[number].fixes[0], lat_deg=49.0)
    frames[number] = replace(frames[number], fixes=(wrong,))
    pipeline = Pipeline(voyage.config, ["ukf"])
    outputs = [pipeline.push(frame) for frame in frames]
    codes = [item.code for output in outputs for item in output.events]
    assert codes.count("fix-far") == codes.count("origin-moved") == 1
    assert abs(outputs[-1].estimates[0].lat_deg - 50.766) < 0.01


@pytest.mark.parametrize("step_s", [1e-10, 0.0, -1.0, 1e6])
def test_an_impossible_step_is_refused(step_s: float) -> None:
    voyage = scenario_voyage("5.3", seconds=5)
    with pytest.raises(WayfixError, match=r"give 0\.05 to 60 s"):
        Pipeline(voyage.config, ["ukf"], step_s)


def test_a_restarted_daemon_is_told_and_the_filters_carry_on() -> None:
    voyage = scenario_voyage("5.3", seconds=20)
    frames = offline_frames(voyage)
    frames[100:] = [replace(frame, boot_id="1" * 16, start_no=2) for frame in frames[100:]]
    pipeline = Pipeline(voyage.config, ["ukf"])
    codes = [item.code for frame in frames for item in pipeline.push(frame).events]
    assert codes.count("daemon-restarted") == 1
    assert codes.count("filter-started") == 1
