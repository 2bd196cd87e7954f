"""Whatever keeps data away, a picture that stopped is shown as stale within three seconds of the station's clock."""

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, cast

import msgpack
import pytest

from common.clock_offset import ClockOffset
from common.codec import encode_frame
from common.errors import CodecError, WayfixError
from common.link_messages import FrameRange
from common.messages import Frame
from shore.link.link import Link, Received, Wants
from shore.live.busy_watch import BusyWatch
from shore.live.run import LiveRun, Options
from shore.logbook.log_writer import LogWriter
from shore.pipeline import Output, Pipeline
from tests.navigate.voyages import BOAT
from tests.station.logs import without_none

SAILED, STOPPED = 150, 70
"""Number of turns (a tenth of a second each) in which all is well, and in which it is not."""
TURN_NS = 100_000_000
AHEAD_NS = 7_700_000_000_000
"""Board's clock less station's clock, ns."""
HOUR_NS = 3_600_000_000_000


class StoppingLink:
    """A board that is well for some time, and then does what `stopped` says, turn by turn."""

    endpoint = "tcp://test"
    refusal = None

    def __init__(self, voyage: list[Frame], stopped: Callable[["StoppingLink"], Received | None]) -> None:
        self.voyage = voyage
        self._stopped = stopped
        self.turn = -1
        self.heard_turn = 0
        self.offset = ClockOffset()
        self.silent = False

    @property
    def now_ns(self) -> int:
        """The station's clock: the frame of a turn ends as the turn begins."""
        return self.voyage[max(self.turn, 0)].t1_ns

    def greeting(self, **other: Any) -> dict[str, Any]:
        first = self.voyage[0]
        return {
            "boot_id": first.boot_id, "clock_id": first.clock_id, "next_seq": 0, "config": without_none(asdict(BOAT)),
            "runs": [["0", 9, 0, 500], [first.boot_id, 1, 0, 0]], **other,
        }  # fmt: skip

    def connect(self, *_arguments: Any, wants: Callable[[], Wants], **_named: Any) -> dict[str, Any]:
        return self.greeting()

    def receive(self, timeout_s: float) -> Received | None:
        self.turn += 1
        if self.turn < SAILED:
            self.heard_turn = self.turn
            return self.sent(self.voyage[self.turn])
        received = self._stopped(self)
        if not self.silent:
            self.heard_turn = self.turn
            board_ns = self.now_ns + AHEAD_NS
            self.offset.add(self.now_ns, board_ns, board_ns, self.now_ns)
        return received

    def sent(self, frame: Frame, behind_ns: int = 0, **other: Any) -> Received:
        """A frame, all its times so much before those of the voyage."""
        identity: dict[str, Any] = {"utc_ns": None, "utc_src": "none", **other}
        fields = msgpack.unpackb(encode_frame(replace(frame, **identity)))
        for name in ("t0_ns", "t1_ns"):  # all others count from t0_ns
            fields[name] += AHEAD_NS - behind_ns
        return Received(frame=msgpack.packb(fields))

    def late(self, behind_ns: int, **other: Any) -> Received:
        """The frame of this turn as if it were of another time."""
        return self.sent(self.voyage[self.turn], behind_ns, **other)

    def ask_soon(self) -> None:
        pass

    def silent_s(self) -> float:
        return (self.turn - self.heard_turn) / 10.0


def lost(link: StoppingLink) -> None:
    link.silent = True


def ended(link: StoppingLink) -> Received | None:
    link.silent = True
    return Received(end={"reason": "SIGTERM", "next_seq": SAILED}) if link.turn == SAILED else None


def no_message(link: StoppingLink) -> Received:
    raise CodecError("not a message of this protocol")


def rebooted_and_silent(link: StoppingLink) -> Received | None:
    """The board greets under another clock; all that comes is of the clock before."""
    if link.turn == SAILED:
        runs = [[link.voyage[0].boot_id, 1, 0, 900], ["b", 2, 0, 0]]
        return Received(connected=link.greeting(boot_id="b", clock_id="other", runs=runs))
    return link.sent(link.voyage[link.turn])


def older_first(link: StoppingLink) -> Received:
    """The newest frame that comes is an hour old, and the next one is newer, as live frames are."""
    if link.turn == SAILED:
        return Received(connected=link.greeting(boot_id="b", clock_id="other", runs=[["b", 2, 0, 900]]))
    return link.late(HOUR_NS, boot_id="b", clock_id="other", start_no=2)


SILENT, FED_NOTHING = "sensors are silent, a receiver of 1 Hz for five periods", "the filter is fed nothing"
REASONS: dict[str, Callable[[StoppingLink], Received | None]] = {
    "the link is lost": lost,
    "the board stopped": ended,
    "the board answers and sends no frame": lambda link: None,
    "frames cannot be decoded": lambda link: Received(frame=b"\x00" * 50),
    "messages cannot be decoded": no_message,
    "the same frame comes again and again": lambda link: link.sent(link.voyage[SAILED - 1]),
    "frames are of an older start, so the pipeline drops them": lambda link: link.sent(
        link.voyage[link.turn], boot_id="0", clock_id="older", start_no=9
    ),
    "the boat's clock stands still": lambda link: link.sent(link.voyage[SAILED - 1], seq=link.turn),
    "the boat's clock went back": lambda link: link.late(20_000_000_000),
    "missing frames hide the new ones": lambda link: link.late(HOUR_NS, boot_id="0", start_no=1),
    "the board was rebooted and is silent": rebooted_and_silent,
    "frames are an hour late": older_first,
    "the boat does not hold what is asked for": lambda link: Received(gone=[FrameRange("0", 0, 499)]),
    SILENT: lambda link: link.sent(link.voyage[link.turn], fixes=(), headings=(), imu=()),
    FED_NOTHING: lambda link: link.sent(link.voyage[link.turn]),
    "the disk of the log is full, then the link is lost": lost,
}


@pytest.mark.parametrize("reason", REASONS)
def test_a_picture_that_stopped_is_stale_within_three_seconds(
    reason: str, voyage: list[Frame], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = StoppingLink(voyage, REASONS[reason])
    for module in ("shore.live.run", "common.clock"):
        monkeypatch.setattr(f"{module}.boottime_ns", lambda: link.now_ns)
    if reason == FED_NOTHING:
        push = Pipeline.push
        monkeypatch.setattr(Pipeline, "push", lambda it, frame: push(it, frame) if frame.seq < SAILED else Output())
    lines: list[tuple[int, str]] = []
    directory = tmp_path if "disk" in reason else None

    def wrote(*_arguments: Any) -> None:
        raise WayfixError("No space left on device")

    def say(line: str) -> None:
        if "no fix yet" not in line and " | " in line:
            lines.append((link.turn, line))

    def is_over() -> bool:
        if link.turn == SAILED - 20:
            monkeypatch.setattr(LogWriter, "write_frame", wrote)
        return link.turn >= SAILED + STOPPED

    LiveRun(cast("Link", link), Options(log_dir=directory), is_over, say).run()
    before = [line for turn, line in lines if turn < SAILED]
    assert before
    assert not any("STALE" in line for line in before), "all was well"
    late = [line for turn, line in lines if turn >= SAILED + (50 if reason == SILENT else 30)]
    assert late
    assert any("NO LOG" in line for line in late) == (directory is not None)
    for line in late:
        estimate, fix, heading = line.rpartition("before: ")[2].removeprefix("NO LOG | ").split(" | ")[:3]
        assert "STALE" in estimate or "°" not in estimate or "COASTING" in estimate, "dead reckoning says so itself"
        assert reason == FED_NOTHING or ("STALE" in fix and "STALE" in heading)


def test_a_picture_stays_fresh_as_long_as_frames_come(voyage: list[Frame], monkeypatch: pytest.MonkeyPatch) -> None:
    link = StoppingLink(voyage, lambda link: link.sent(link.voyage[link.turn]))
    for module in ("shore.live.run", "common.clock"):
        monkeypatch.setattr(f"{module}.boottime_ns", lambda: link.now_ns)
    lines: list[str] = []
    LiveRun(cast("Link", link), Options(), lambda: link.turn >= SAILED + STOPPED, lines.append).run()
    assert not any("STALE" in line for line in lines)


def test_a_run_that_is_held_up_is_said_by_another_thread() -> None:
    now_ns, said = [0], list[str]()
    watch = BusyWatch(said.append, lambda: now_ns[0])
    for tenths in range(70):
        now_ns[0] = tenths * TURN_NS
        if tenths < 10:
            watch.beat()
        watch.look()
    assert len(said) == 5
    assert said[0] == "STALE: this station has been held up for 2 s, what it shows is of before"
    watch.beat()
    watch.look()
    assert len(said) == 5
