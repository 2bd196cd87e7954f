"""What a replay is for: a new log, a show at the boat's pace, filters side by side."""

import json
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from common.codec import encode_frame
from common.events import event
from common.messages import Frame
from shore.logbook.foxglove import event_of
from shore.logbook.log_reader import read_log
from shore.logbook.log_writer import log_at
from shore.main import main
from shore.pipeline import Pipeline
from shore.replay.run import Pace, Replay
from shore.watchers.say import SayEvents
from shore.watchers.status import StatusLine
from shore.watchers.watcher import Watchers
from tests.station.logs import OTHER, UTC_NS, Done, all_equal, log_of, session, starts, with_backfill


@pytest.mark.parametrize("order", ["arrival", "time"])
def test_a_new_log_is_a_log_like_any_other(
    order: str, tmp_path: Path, voyage: list[Frame], capsys: pytest.CaptureFixture[str]
) -> None:
    """With two configurations and a backfill; its own replay finds everything again."""
    frames = with_backfill(starts(voyage)[:280])
    path, new = log_of(tmp_path, frames, {160: OTHER}), tmp_path / "new.mcap"
    asked = ["replay", str(path), "--record", str(new), "--order", order, "--filters", "kf,ukf"]
    assert main(asked) == 0
    again, source = Done(new), Done(path, order, ("kf", "ukf"))
    assert [each.seq for each in again.frames] == [each.seq for each in source.frames]
    assert again.configs == source.configs
    assert again.estimates == source.estimates
    assert all_equal(again, len(source.estimates))
    options = again.run.start.options
    assert options["filters"] == ["kf", "ukf"]
    assert options["order"] == order
    assert options["replayed_from"] == path.name
    times = [record.log_time_ns for record in read_log(new).records("/frames")]
    assert times == sorted(times)
    if order == "arrival":
        assert list(read_log(new).frames()) == list(read_log(path).frames())
    assert main(asked) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(("order", "of_link"), [("arrival", 1), ("time", 0)])
def test_the_trip_is_passed_on_and_in_order_of_arrival_the_link(
    order: str, of_link: int, tmp_path: Path, voyage: list[Frame]
) -> None:
    path, new = tmp_path / "a.mcap", tmp_path / "b.mcap"
    writer = log_at(path)
    writer.write_session(session(), UTC_NS)
    writer.write_session({"kind": "trip", "name": "trial"}, UTC_NS)
    for number, frame in enumerate(voyage[:40]):
        writer.write_frame(encode_frame(frame), frame, UTC_NS + number)
        if number == 20:
            writer.write_event(event("link-restored", frame.t1_ns, "link", age_s=4.0), UTC_NS + number)
    writer.write_link({"kind": "end", "sent": 40}, UTC_NS + 40)
    writer.close()
    assert main(["replay", str(path), "--record", str(new), "--order", order]) == 0
    reader = read_log(new)
    kinds = [record["kind"] for record in reader.session()]
    assert kinds == ["start", "trip", "end", "summary"]
    assert [event_of(each)["code"] for each in reader.events()].count("link-restored") == of_link
    assert [record.json()["sent"] for record in reader.records("/link")] == [40] * of_link


@pytest.mark.parametrize("after", [0, 100])
def test_ctrl_c_leaves_no_half_log(
    after: int, tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    push, pushes = Pipeline.push, count()

    def interrupted(self: Pipeline, frame: Frame) -> Any:
        if next(pushes) == after:
            raise KeyboardInterrupt
        return push(self, frame)

    monkeypatch.setattr(Pipeline, "push", interrupted)
    new = tmp_path / "new.mcap"
    assert main(["replay", str(log), "--record", str(new), "--json"]) == 0
    said = capsys.readouterr()
    assert f"stopped after {after} frames" in said.err
    assert list(tmp_path.iterdir()) == []
    if after:
        summary = json.loads(said.out.splitlines()[-1])
        assert summary["whole"] is False
        assert summary["estimates"]["equal"] == after


def test_filters_are_compared_on_a_log(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(log), "--filters", "ukf,kf", "--json"]) == 0
    words = capsys.readouterr().out
    assert "NIS per dimension" in words
    filters = json.loads(words.splitlines()[-1])["filters"]
    assert list(filters) == ["ukf", "kf"]
    assert 0.4 < filters["ukf"]["nis_position"] < 2.0
    assert filters["ukf"]["sigma_m"] > 0.0


class Clock:
    """Time that only passes by sleeping."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.slept: list[float] = []

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now_s += seconds


def test_at_a_speed_it_waits_for_the_boats_time_and_says_a_line_a_second(tmp_path: Path, voyage: list[Frame]) -> None:
    said: list[str] = []
    clock = Clock()
    replay = Replay(log_of(tmp_path, [*voyage[:100], *voyage[120:], *voyage[100:110]]))
    watchers = Watchers(SayEvents(said.append), StatusLine("ukf", said.append))
    replay.run(watchers, Pace(4.0, lambda: clock.now_s, clock.sleep))
    assert clock.now_s - 100.0 == pytest.approx((len(voyage) - 1) * 0.1 / 4.0, abs=1e-6)
    assert max(clock.slept) <= 0.2
    lines = [line for line in said if line.startswith("ukf 5")]
    assert len(lines) == 7
    assert "40 frames, 0 missing" in lines[0]
    assert "20 missing" in lines[-1]
    assert any(line.startswith("info: filters are aligned") for line in said)
