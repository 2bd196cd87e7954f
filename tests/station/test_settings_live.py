"""A live run under settings: its limits make the events, its terminal shows what is wanted, its log says both."""

from dataclasses import asdict
from itertools import count
from pathlib import Path
from typing import Any, cast

import pytest

from common.clock_offset import ClockOffset
from common.codec import encode_frame
from common.events import event
from common.messages import LEVELS, Frame
from shore.link.link import Link, Received
from shore.live.run import LiveRun, Options
from shore.logbook.log_reader import read_log
from shore.pipeline import Pipeline
from shore.replay.run import Replay
from shore.settings.station import DEFAULTS, DisplaySettings, LimitSettings, StationSettings, station_settings
from shore.watchers.newest import Newest
from shore.watchers.say import SayEvents
from shore.watchers.status import StatusLine
from shore.watchers.watcher import SourceState, Start, Watchers
from tests.navigate.voyages import BOAT
from tests.station.logs import UTC_NS, session, without_none


def options_of(log: Path) -> dict[str, Any]:
    options: dict[str, Any] = next(read_log(log).session())["options"]
    return options


class SilentBoard:
    """A link whose board sends frames, is silent for so long, and then ends."""

    endpoint = "tcp://test"
    refusal = None

    def __init__(self, frames: list[Frame], silences_s: list[float]) -> None:
        self._frames, self._silences_s = list(frames), list(silences_s)
        self.offset = ClockOffset()

    def connect(self, *_arguments: Any, **_named: Any) -> dict[str, Any]:
        config = without_none(asdict(BOAT))
        return {"boot_id": self._frames[0].boot_id, "next_seq": 0, "config": config, "runs": []}

    def receive(self, timeout_s: float) -> Received | None:
        if self._frames:
            return Received(frame=encode_frame(self._frames.pop(0)))
        return None if self._silences_s else Received(end={"sent": 0, "reason": "test"})

    def ask_soon(self) -> None:
        pass

    def silent_s(self) -> float:
        return self._silences_s.pop(0) if self._silences_s and not self._frames else 0.0


def live(
    directory: Path, frames: list[Frame], settings: StationSettings, monkeypatch: pytest.MonkeyPatch
) -> tuple[Path, list[str]]:
    """A live run under these settings: its log, and what it said; each look at its clock takes half a second."""
    now_ns = count(10**12, 500_000_000)
    monkeypatch.setattr("shore.live.run.boottime_ns", lambda: next(now_ns))
    said: list[str] = []
    link = cast("Link", SilentBoard(frames, [2.0, 4.0, 8.0]))
    run = LiveRun(link, Options(settings, log_dir=directory, until_end=True), lambda: False, said.append)
    run.run()
    assert run.log_path is not None
    return run.log_path, said


def codes_of(log: Path) -> list[str]:
    return [record.json()["code"] for record in read_log(log).records("/events")]


def test_a_live_run_keeps_its_limits_and_shows_what_it_is_asked_to(
    tmp_path: Path, voyage: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    log, said = live(tmp_path / "default", voyage[:60], DEFAULTS, monkeypatch)
    assert "link-lost" in codes_of(log)
    assert any("no frame from the boat for 4.0 s" in line for line in said)
    assert any(" frames, " in line for line in said)
    path = tmp_path / "wayfix.toml"
    path.write_text('[filter]\nnames = ["ukf"]\n[limits]\nlink_lost_s = 7\n[display]\nstatus_line = false\n')
    log, said = live(tmp_path / "patient", voyage[:60], station_settings(path), monkeypatch)
    assert any("no frame from the boat for 8.0 s" in line for line in said)
    assert not any(" frames, " in line for line in said)
    options = options_of(log)
    assert options["filters"] == ["ukf"]
    assert options["settings"]["limits"] == {"link_lost_s": 7.0, "log_behind_s": 5.0, "estimate_stale_s": 2.0}
    assert options["settings"]["display"] == {"status_line": False, "events_from": "info"}
    assert options["settings"]["from"]["limits.link_lost_s"] == "wayfix.toml"
    path.write_text("[limits]\nlink_lost_s = 9\n[display]\nevents_from = 'error'\n")
    log, said = live(tmp_path / "deaf", voyage[:60], station_settings(path), monkeypatch)
    assert "link-lost" not in codes_of(log)
    assert "filter-started" in codes_of(log)
    assert not any("filters start" in line for line in said)
    replay = Replay(log)
    replay.run(Watchers())
    assert replay.comparison is not None
    assert replay.comparison.first is None
    assert replay.comparison.estimates.equal >= 50


def test_a_slow_disk_is_said_at_its_limit(tmp_path: Path, voyage: list[Frame], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shore.live.log.LiveLog.behind_s", 6.0)
    assert "log-behind" in codes_of(live(tmp_path / "a", voyage[:20], DEFAULTS, monkeypatch)[0])
    patient = StationSettings(limits=LimitSettings(log_behind_s=7.0))
    assert "log-behind" not in codes_of(live(tmp_path / "b", voyage[:20], patient, monkeypatch)[0])


@pytest.mark.parametrize("lowest", LEVELS)
def test_events_below_the_level_are_not_said(lowest: str) -> None:
    said: list[str] = []
    screen = SayEvents(said.append, StationSettings(display=DisplaySettings(events_from=lowest)))
    for level in LEVELS:
        happening = event("mark", 1, "test", text="a", client="b")
        screen.happened(type(happening)(**{**asdict(happening), "level": level}), UTC_NS)
    assert [line.partition(":")[0] for line in said] == list(LEVELS[LEVELS.index(lowest) :])


def test_an_estimate_is_stale_at_its_limit(voyage: list[Frame]) -> None:
    pipeline = Pipeline(BOAT, ("ukf",))
    quick, slow = Newest(BOAT, "ukf", LimitSettings(estimate_stale_s=0.5)), Newest(BOAT, "ukf")
    for frame in voyage[:60]:
        output = pipeline.push(frame)
        quick.take(frame, output)
        slow.take(frame, output)
    assert slow.estimate is not None
    estimate = slow.estimate
    for newest in (quick, slow):
        newest.t_ns = estimate.t_ns + 10**9
    assert (quick.age_of_estimate(estimate).is_stale, slow.age_of_estimate(estimate).is_stale) == (True, False)


def test_no_status_line_where_none_is_wanted(voyage: list[Frame]) -> None:
    said: list[str] = []
    for wanted in (False, True):
        line = StatusLine("ukf", said.append, StationSettings(display=DisplaySettings(status_line=wanted)))
        line.begin(Start(session(), BOAT), UTC_NS)
        line.each_second(SourceState(1, 0))
    assert len(said) == 1
