"""Replay of a log in order of arrival, which finds the live run again, and of boat time, which is the best track."""

import gc
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from common.messages import Frame
from shore.logbook.log_reader import read_log
from shore.main import main
from shore.replay.frames import Frames, Span
from shore.replay.run import Replay
from tests.navigate.voyages import BOAT
from tests.station.logs import OTHER, Done, all_equal, log_of, starts, with_backfill


def last(estimates: Sequence[dict[str, Any]]) -> tuple[float, ...]:
    return (*estimates[-1]["state"], *estimates[-1]["covariance"])


def test_in_order_of_time_a_late_backfill_is_in_its_place(tmp_path: Path, voyage: list[Frame]) -> None:
    path = log_of(tmp_path, with_backfill(voyage))
    straight = Done(log_of(tmp_path, voyage), "time")
    by_time, by_arrival = Done(path, "time"), Done(path)
    assert [frame.seq for frame in by_time.frames] == list(range(len(voyage)))
    assert by_time.estimates == straight.estimates
    assert len(by_time.estimates) == len(voyage)
    assert by_time.run.source.late == by_arrival.run.source.late == 99
    assert by_time.run.comparison is None
    assert all_equal(by_arrival, len(voyage) - 100)
    assert by_arrival.estimates[101] != by_time.estimates[201]


def test_shuffled_within_the_horizon_both_orders_end_alike(tmp_path: Path, voyage: list[Frame]) -> None:
    frames = [voyage[0], *(voyage[i] for i in sorted(range(1, 250), key=lambda i: i + 7 * (i % 4))), *voyage[280:]]
    path = log_of(tmp_path, frames)
    by_time, by_arrival = Done(path, "time"), Done(path)
    assert by_time.run.source.late == 0
    assert last(by_arrival.estimates) == pytest.approx(last(by_time.estimates), rel=0, abs=1e-9)


def test_starts_and_clocks_follow_each_other_in_their_order(tmp_path: Path, voyage: list[Frame]) -> None:
    frames = starts(voyage)
    # The first frame that comes is of the third start; the second start's frames come last.
    mixed = [frames[200], *frames[:100], *frames[201:], *frames[100:200]]
    by_time = Done(log_of(tmp_path, mixed), "time")
    assert by_time.frames == frames
    assert len(by_time.estimates) == len(frames)
    assert by_time.run.source.late == 200


def test_a_start_keeps_its_configuration_when_its_frames_come_late(tmp_path: Path, voyage: list[Frame]) -> None:
    frames = starts(voyage)
    mixed = [*frames[:90], *frames[100:200], *frames[90:100]]
    by_time = Done(log_of(tmp_path, mixed, {90: OTHER}), "time")
    assert by_time.frames == frames[:200]
    assert by_time.configs == [BOAT] * 100 + [OTHER] * 100


def test_a_new_configuration_begins_anew_in_both_orders(tmp_path: Path, voyage: list[Frame]) -> None:
    frames = starts(voyage)[:200]
    path = log_of(tmp_path, frames, {100: OTHER})
    by_time, by_arrival = Done(path, "time"), Done(path)
    assert by_time.estimates == by_arrival.estimates
    assert all_equal(by_arrival, len(frames))


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
    assert (summary["estimates"]["made"], summary["estimates"]["recorded"]) == (len(voyage), 0)
    assert "no live run" in summary["estimates"]["not_compared"]
    assert main(["replay", str(path)]) == 0
    words = capsys.readouterr().out
    assert "99 frames came more than 5 s late; --order time puts them in their place" in words
    assert f"equal to the recorded ones: {len(voyage) - 100} of {len(voyage) - 100}" in words


def test_a_span_is_in_seconds_of_the_log(log: Path, voyage: list[Frame]) -> None:
    part = [arrival.frame.seq for arrival in Frames(read_log(log), "arrival", Span(10.0, 20.0))]
    assert part == list(range(99, 200))
    run = Replay(log, span=Span(None, 12.0))
    assert len(list(run)) == 120
    assert run.comparison is not None
    assert run.comparison.estimates.equal == run.comparison.estimates.recorded == run.comparison.estimates.made == 120
    assert run.comparison.first is None


def test_seconds_go_on_over_a_reboot(tmp_path: Path, voyage: list[Frame]) -> None:
    path = log_of(tmp_path, starts(voyage))
    times = [arrival.t_s for arrival in Frames(read_log(path))]
    assert times == pytest.approx([0.1 * (place + 1) for place in range(len(voyage))])


def test_a_hole_before_a_new_start_of_the_daemon_counts(tmp_path: Path, voyage: list[Frame]) -> None:
    frames = starts(voyage)
    path = log_of(tmp_path, [*frames[:90], *frames[150:200]])
    times = [arrival.t_s for arrival in Frames(read_log(path))]
    assert (times[89], times[90]) == pytest.approx((9.0, 15.1))


def test_a_span_without_frames_is_a_sentence(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(log), "--from", "900"]) == 2
    assert "holds no frame there; give another --from or --to" in capsys.readouterr().err
    assert main(["replay", str(log), "--from", "9", "--to", "8"]) == 2
    assert "--to lies before --from" in capsys.readouterr().err


def test_frames_do_not_stay_in_memory(log: Path) -> None:
    def alive() -> int:
        return sum(type(each) is Frame for each in gc.get_objects())

    before = alive()
    counts = [alive() - before for step in Replay(log) if step.frame.seq % 100 == 99]
    assert max(counts) < 5
