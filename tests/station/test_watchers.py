"""Source -> pipeline -> watchers: every watcher sees each step once and in order, from whatever source it comes."""

from collections.abc import Iterable
from dataclasses import asdict, replace
from itertools import count
from pathlib import Path
from typing import Any, cast

import pytest

from common.clock_offset import ClockOffset
from common.codec import encode_frame
from common.errors import WayfixError
from common.events import event
from common.messages import Event, Frame
from shore.imports.log_maker import LogMaker
from shore.link.link import Link, Received
from shore.live.run import LiveRun, Options
from shore.logbook.log_reader import read_log
from shore.logbook.log_writer import LogWriter
from shore.logbook.schemas import LINK, SESSION
from shore.pipeline import Output, Pipeline
from shore.replay.run import Replay
from shore.settings.station import FilterSettings, StationSettings
from shore.watchers.log import WholeLog
from shore.watchers.watcher import Arrival, RunSeconds, SourceState, Start, Step, Watcher, Watchers
from tests.navigate.voyages import BOAT
from tests.station.logs import OTHER, UTC_NS, log_of, session, without_none

UKF = StationSettings(FilterSettings(("ukf",)))


class Seen(Watcher):
    """Keeps the calls."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.steps: list[Step] = []

    def begin(self, start: Start, t_ns: int) -> None:
        self.calls.append("begin")

    def take(self, step: Step) -> None:
        self.calls.append("take")
        self.steps.append(step)

    def happened(self, event: Event, t_ns: int) -> None:
        self.calls.append(event.code)

    def note(self, topic: str, record: dict[str, Any], t_ns: int) -> None:
        self.calls.append(f"{topic} {record['kind']}")

    def each_second(self, now: SourceState) -> None:
        self.calls.append("each_second")

    def end(self, tally: dict[str, Any], t_ns: int) -> None:
        self.calls.append("end")


def full_disk(_writer: LogWriter) -> int:
    raise WayfixError("the log cannot be written any further (no space left on device)")


def step_of(frame: Frame, output: Output | None = None) -> Step:
    start = Start(session(), BOAT)
    return Step.of(Arrival(encode_frame(frame), frame, start, UTC_NS), output or Output())


class Board:
    """A link whose board sends these frames, and then ends."""

    endpoint = "tcp://test"
    refusal = None

    def __init__(self, frames: Iterable[Frame]) -> None:
        self._frames = list(frames)
        self.offset = ClockOffset()

    def connect(self, *_arguments: Any, **_named: Any) -> dict[str, Any]:
        config = without_none(asdict(BOAT))
        return {"boot_id": self._frames[0].boot_id, "next_seq": 0, "config": config, "runs": []}

    def receive(self, timeout_s: float) -> Received:
        if self._frames:
            return Received(frame=encode_frame(self._frames.pop(0)))
        return Received(end={"sent": 0, "reason": "test"})

    def ask_soon(self) -> None:
        pass

    def silent_s(self) -> float:
        return 0.0


def test_several_watchers_see_the_same_in_their_order(voyage: list[Frame]) -> None:
    first, second = Seen(), Seen()
    both = Watchers(first, second)
    both.begin(Start(session(), BOAT), UTC_NS)
    both.take(step_of(voyage[0]))
    both.happened(event("link-restored", 0, "link", age_s=1.0), UTC_NS)
    both.note(LINK, {"kind": "end"}, UTC_NS)
    both.each_second(SourceState(1, 0))
    both.end({}, UTC_NS)
    assert first.calls == second.calls
    assert first.calls == ["begin", "take", "link-restored", "/link end", "each_second", "end"]
    assert first.steps[0] is second.steps[0]


def test_a_replay_begins_for_each_configuration_and_takes_every_frame_once(tmp_path: Path, voyage: list[Frame]) -> None:
    seen = Seen()
    Replay(log_of(tmp_path, voyage[:60], {40: OTHER})).run(seen)
    assert seen.calls == ["begin", *["take"] * 40, "begin", *["take"] * 20, "end"]
    assert [step.frame.seq for step in seen.steps] == [frame.seq for frame in voyage[:60]]
    assert seen.steps[39].start.config == BOAT
    assert seen.steps[40].start.config == OTHER


def test_an_empty_replay_has_no_begin_and_no_end(tmp_path: Path) -> None:
    seen = Seen()
    Replay(log_of(tmp_path, [])).run(seen)
    assert seen.calls == []


def test_live_replay_and_import_of_the_same_frames_make_the_same_steps(tmp_path: Path, voyage: list[Frame]) -> None:
    frames = voyage[:80]
    options = Options(UKF, log_dir=tmp_path / "live", until_end=True)
    run = LiveRun(cast("Link", Board(frames)), options, lambda: False, lambda _line: None)
    run.run()
    assert run.log_path is not None
    live = Seen()
    Replay(run.log_path).run(live)
    maker = LogMaker({"config": without_none(asdict(BOAT))}, UKF, None)
    assert maker.write(tmp_path / "imported.mcap", map(encode_frame, frames), None, dict)
    imported = Seen()
    Replay(tmp_path / "imported.mcap").run(imported)
    assert [step.records for step in live.steps] == [step.records for step in imported.steps]
    assert [step.events for step in live.steps] == [step.events for step in imported.steps]
    for path in (run.log_path, tmp_path / "imported.mcap"):
        replay = Replay(path)
        replay.run(Watchers())
        assert replay.comparison is not None
        assert replay.comparison.first is None
        assert replay.comparison.estimates.equal >= 70


def test_the_log_of_a_live_run_holds_the_frame_that_the_filters_broke_on(
    tmp_path: Path, voyage: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_self: Pipeline, frame: Frame) -> Output:
        if frame.seq == voyage[3].seq:
            raise ZeroDivisionError
        return Output()

    monkeypatch.setattr(Pipeline, "push", broken)
    options = Options(UKF, log_dir=tmp_path, until_end=True)
    run = LiveRun(cast("Link", Board(voyage[:10])), options, lambda: False, lambda _line: None)
    with pytest.raises(ZeroDivisionError):
        run.run()
    assert run.log_path is not None
    assert list(read_log(run.log_path).frames()) == [encode_frame(frame) for frame in voyage[:4]]


def test_a_whole_log_appears_only_when_its_run_has_ended(tmp_path: Path, voyage: list[Frame]) -> None:
    path = tmp_path / "whole.mcap"
    with WholeLog(path) as log:
        log.begin(Start(session(), BOAT), UTC_NS)
        log.take(step_of(voyage[0]))
    assert list(tmp_path.iterdir()) == []
    with WholeLog(path) as log:
        log.begin(Start(session(), BOAT), UTC_NS)
        log.note(SESSION, {"kind": "trip", "name": "trial"}, UTC_NS)
        log.take(step_of(voyage[0]))
        assert not path.exists()
        log.end({"received": 1}, UTC_NS)
        assert path.exists()
    reader = read_log(path)
    assert [record["kind"] for record in reader.session()] == ["start", "trip", "end", "summary"]
    assert list(reader.frames()) == [encode_frame(voyage[0])]
    with pytest.raises(WayfixError, match="exists already"):
        WholeLog(path)


def test_seconds_of_a_run_go_on_over_a_reboot_of_the_board(voyage: list[Frame]) -> None:
    seconds = RunSeconds()
    before = [seconds.at(frame) for frame in voyage[:20]]
    assert before == pytest.approx([0.1 * (number + 1) for number in range(20)])
    rebooted = replace(voyage[0], clock_id="after", t0_ns=5, t1_ns=5 + 10**8)
    assert seconds.at(rebooted) == pytest.approx(before[-1] + 0.1)
    assert seconds.at(voyage[3]) == before[3]


def test_an_import_without_a_frame_opens_no_log(tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    out.write_bytes(b"somebody's")
    maker = LogMaker({"config": without_none(asdict(BOAT))}, UKF, None)
    assert not maker.write(out, [b"no frame"], None, dict)
    assert maker.written.bad == 1
    assert out.read_bytes() == b"somebody's"
    assert list(tmp_path.iterdir()) == [out]


def test_a_fault_of_the_disk_is_in_the_status_line_of_the_same_second(
    tmp_path: Path, voyage: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_ns = count(10**12, 100_000_000)
    monkeypatch.setattr("shore.live.run.boottime_ns", lambda: next(now_ns))
    said: list[str] = []
    options = Options(UKF, log_dir=tmp_path, until_end=True)
    run = LiveRun(cast("Link", Board(voyage[:40])), options, lambda: False, said.append)
    monkeypatch.setattr("shore.logbook.log_writer.LogWriter.flush", full_disk)
    run.run()
    fault = next(place for place, line in enumerate(said) if line.startswith("error: log:"))
    status = next(line for line in said[fault:] if " frames, " in line)
    assert status.startswith("NO LOG | ")
