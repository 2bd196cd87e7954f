"""Replay of a log in order of arrival, which finds the live run again, and of boat time, which is the best track."""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from common.codec import decode_frame, encode_frame
from common.messages import Frame
from common.sensors import BoatConfig
from shore.logbook.record import LogWriter
from shore.main import main
from shore.pipeline import Pipeline
from shore.replay import Arrival, in_order_of_time, replay
from tests.navigate.voyages import BOAT, frames_of, sail

UTC_NS = 1_795_000_000_000_000_000
FILTERS = ("ukf",)


@pytest.fixture(scope="module")
def voyage() -> list[Frame]:
    """As received: IMU columns travel as 32-bit floats."""
    return [decode_frame(encode_frame(frame)) for frame in frames_of(sail(32, 0.05), 2)]


def without_none(value: Any) -> Any:
    """As on the wire: what is missing is absent."""
    if isinstance(value, dict):
        return {key: without_none(each) for key, each in value.items() if each is not None}
    return [without_none(each) for each in value] if isinstance(value, tuple) else value


def session(config: BoatConfig = BOAT) -> dict[str, Any]:
    return {
        "kind": "start",
        "options": {"filters": list(FILTERS)},
        "connected": {"config": without_none(asdict(config))},
    }


def log_of(directory: Path, frames: Sequence[Frame], changes: dict[int, BoatConfig] | None = None) -> Path:
    """What a live run would have written; `changes`: before the frame of that number the board has a new file."""
    writer = LogWriter(directory, "springer", UTC_NS)
    writer.write_session(session(), UTC_NS)
    pipeline = Pipeline(BOAT, FILTERS)
    for number, frame in enumerate(frames):
        if changes and number in changes:
            writer.write_session(session(changes[number]), UTC_NS)
            pipeline = Pipeline(changes[number], FILTERS)
        writer.write_frame(encode_frame(frame), frame, UTC_NS + number)
        for estimate in pipeline.push(frame).estimates:
            writer.write_estimate(estimate.as_record(), UTC_NS + number)
    writer.close()
    return writer.path


def with_backfill(frames: list[Frame]) -> list[Frame]:
    """Ten seconds of the link are lost and come after it has returned."""
    return [*frames[:100], *frames[200:250], *frames[100:200], *frames[250:]]


def last(estimates: Sequence[dict[str, Any]]) -> tuple[float, ...]:
    return (*estimates[-1]["state"], *estimates[-1]["covariance"])


def test_in_order_of_time_a_late_backfill_is_in_its_place(tmp_path: Path, voyage: list[Frame]) -> None:
    path = log_of(tmp_path, with_backfill(voyage))
    straight = replay(log_of(tmp_path, voyage), order="time")
    by_time, by_arrival = (replay(path, order=order) for order in ("time", "arrival"))
    assert [frame.seq for frame in by_time.frames] == list(range(len(voyage)))
    assert by_time.estimates == straight.estimates
    assert len(by_time.estimates) == len(voyage)
    assert by_time.late_frames == by_arrival.late_frames == 99
    assert by_time.recorded == 0
    assert by_arrival.equal == by_arrival.recorded == len(by_arrival.estimates) == len(voyage) - 100
    assert by_arrival.estimates[101] != by_time.estimates[201]


def test_shuffled_within_the_horizon_both_orders_end_alike(tmp_path: Path, voyage: list[Frame]) -> None:
    frames = [voyage[0], *(voyage[i] for i in sorted(range(1, 250), key=lambda i: i + 7 * (i % 4))), *voyage[280:]]
    path = log_of(tmp_path, frames)
    by_time, by_arrival = (replay(path, order=order) for order in ("time", "arrival"))
    assert by_time.late_frames == 0
    assert last(by_arrival.estimates) == pytest.approx(last(by_time.estimates), rel=0, abs=1e-9)


def starts(frames: list[Frame]) -> list[Frame]:
    """Three starts of the daemon, the last one after a reboot: its clock begins again."""
    back_ns = frames[200].t0_ns - 1_000_000_000
    named = []
    for frame in frames:
        if frame.seq < 100:
            named.append(frame)
        elif frame.seq < 200:
            named.append(replace(frame, boot_id="b2", start_no=2, seq=frame.seq - 100))
        else:
            t0_ns, t1_ns = frame.t0_ns - back_ns, frame.t1_ns - back_ns
            shifted: dict[str, Any] = {
                kind: tuple(replace(item, t_ns=item.t_ns - back_ns) for item in getattr(frame, kind))
                for kind in ("fixes", "headings", "imu")
            }
            named.append(replace(frame, boot_id="b3", clock_id="c2", start_no=3, t0_ns=t0_ns, t1_ns=t1_ns, **shifted))
    return named


def test_starts_and_clocks_follow_each_other_in_their_order(tmp_path: Path, voyage: list[Frame]) -> None:
    frames = starts(voyage)
    # The first frame that comes is of the third start; the second start's frames come last.
    mixed = [frames[200], *frames[:100], *frames[201:], *frames[100:200]]
    ordered = in_order_of_time([Arrival(frame, BOAT) for frame in mixed])
    assert [frame for frame, _ in ordered] == frames
    by_time = replay(log_of(tmp_path, mixed), order="time")
    assert len(by_time.estimates) == len(frames)
    assert by_time.late_frames == 200


def test_a_start_keeps_its_configuration_when_its_frames_come_late(voyage: list[Frame]) -> None:
    frames = starts(voyage)
    other = replace(BOAT, sensor=BOAT.sensor[:2])
    arrivals = [Arrival(frame, BOAT) for frame in frames[:90]]
    arrivals += [Arrival(frame, other) for frame in (*frames[100:200], *frames[90:100])]
    ordered = in_order_of_time(arrivals)
    assert [config for _, config in ordered] == [BOAT] * 100 + [other] * 100


def test_a_new_configuration_begins_anew_in_both_orders(tmp_path: Path, voyage: list[Frame]) -> None:
    frames = starts(voyage)[:200]
    other = replace(BOAT, sensor=BOAT.sensor[:2])
    path = log_of(tmp_path, frames, {100: other})
    by_time, by_arrival = (replay(path, order=order) for order in ("time", "arrival"))
    assert by_time.estimates == by_arrival.estimates
    assert by_arrival.equal == by_arrival.recorded == len(frames)


def test_the_command_says_in_which_order_it_replayed(
    tmp_path: Path, voyage: list[Frame], capsys: pytest.CaptureFixture[str]
) -> None:
    path = log_of(tmp_path, with_backfill(voyage))
    assert main(["replay", str(path), "--order", "time", "--json"]) == 0
    words = capsys.readouterr().out
    assert "in order of boat time" in words
    assert "equal to the recorded" not in words
    summary = json.loads(words.splitlines()[-1])
    assert summary["order"] == "time"
    assert summary["frames"]["late"] == 99
    assert summary["estimates"] == {"made": len(voyage), "recorded": 0, "equal": 0}
    assert main(["replay", str(path)]) == 0
    words = capsys.readouterr().out
    assert "99 frames came more than 5 s late; --order time puts them in their place" in words
    assert f"equal to the recorded ones: {len(voyage) - 100} of {len(voyage) - 100}" in words
