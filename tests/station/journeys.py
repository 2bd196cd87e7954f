"""A board with a spool, over a link that sends what is missing before what is new, on a clock of its own."""

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, cast

import pytest

from common.clock_offset import ClockOffset
from common.codec import encode_frame
from common.link_messages import FrameRange
from common.messages import Frame, SensorHealth
from shore.link.link import Link, Received, Wants
from shore.live.run import LiveRun, Options
from shore.settings.station import DEFAULTS, StationSettings
from tests.navigate.voyages import BOAT
from tests.station.logs import UTC_NS, without_none

PERIOD_NS = 100_000_000
FILL = 20
"""Number of missing frames that are sent between two new ones."""


MOST_RUNS = 1000


class Board:
    """Makes frames on a steady clock, and keeps them all; `sensors` gives the measurements of a frame that is made."""

    def __init__(self, voyage: list[Frame]) -> None:
        self._voyage = voyage
        self.made: dict[str, list[Frame]] = {}
        self.t_ns = voyage[0].t0_ns
        self.has_sensors = True
        self.clock_id = voyage[0].clock_id
        self.numbers: dict[str, int] = {}
        """Number of each start, by boot_id."""
        self.held_from: dict[str, int] = {}
        """The first frame that the spool still holds, by boot_id; 0 where it says nothing."""
        self.restart()

    def restart(self, start_no: int | None = None) -> None:
        """The daemon is started, on the same clock. start_no: what its counter says, where it does not go on."""
        self.boot_id = f"{len(self.numbers) + 1:016x}"
        self.made[self.boot_id] = []
        self.numbers[self.boot_id] = len(self.numbers) + 1 if start_no is None else start_no

    def reboot(self, start_no: int | None = None) -> None:
        """The board itself is started: its clock begins again."""
        self.clock_id = f"clock{len(self.made) + 1}"
        self.restart(start_no)

    def make(self, count: int = 1) -> None:
        """Frames go by, whether a station is there or not."""
        for _ in range(count):
            own = self.made[self.boot_id]
            number = (self.t_ns - self._voyage[0].t0_ns) // PERIOD_NS
            frame = self._voyage[number if self.has_sensors else 0]
            identity: dict[str, Any] = {
                "boat_id": "springer", "boot_id": self.boot_id, "seq": len(own), "clock_id": self.clock_id,
                "start_no": self.numbers[self.boot_id], "t0_ns": self.t_ns, "t1_ns": self.t_ns + PERIOD_NS,
                "utc_ns": UTC_NS + self.t_ns, "utc_src": "gnss",
            }  # fmt: skip
            nothing: dict[str, Any] = dict.fromkeys(("fixes", "headings", "imu", "events"), ())
            state, reason = ("delivering", None) if self.has_sensors else ("missing", "no such file")
            health = SensorHealth(sensor="gps1", t_ns=self.t_ns + 5_000, state=state, reason=reason)
            own.append(replace(frame, **identity, **({} if self.has_sensors else nothing), health=(health,)))
            self.t_ns += PERIOD_NS

    @property
    def count(self) -> int:
        return sum(map(len, self.made.values()))


class SpoolLink:
    """A `Link` to such a board that lives for `seconds` of boat time; what is missing comes before what is new."""

    endpoint = "tcp://test"
    refusal = None

    def __init__(self, board: Board, seconds: float, fill: int = FILL) -> None:
        self._board = board
        self._live = round(seconds * 1e9 / PERIOD_NS)
        self._fill = fill
        self._sent = 0
        self.offset = ClockOffset()
        self.is_over = False

    def connect(self, *_arguments: Any, wants: Callable[[], Wants], **_named: Any) -> dict[str, Any]:
        self._wants = wants
        return self._greeting()

    def _greeting(self) -> dict[str, Any]:
        made, boot_id = self._board.made, self._board.boot_id
        self._greeted = boot_id
        runs = [[name, self._board.numbers[name], 0, len(frames)] for name, frames in made.items()]
        unlisted = runs[:-MOST_RUNS]
        config = without_none(asdict(BOAT))
        return {
            "boot_id": boot_id, "clock_id": self._board.clock_id, "next_seq": len(made[boot_id]), "config": config,
            "runs": runs[-MOST_RUNS:], "unlisted": [len(unlisted), sum(run[3] for run in unlisted)],
        }  # fmt: skip

    def receive(self, timeout_s: float) -> Received | None:
        if self._greeted != self._board.boot_id:
            return Received(connected=self._greeting())
        missing = self._wants().missing
        if missing and missing[0].first < (held := self._board.held_from.get(missing[0].boot_id, 0)):
            return Received(gone=[FrameRange(missing[0].boot_id, missing[0].first, min(missing[0].last, held - 1))])
        if missing and self._sent < self._fill:
            self._sent += 1
            return Received(frame=encode_frame(self._board.made[missing[0].boot_id][missing[0].first]))
        self._sent = 0
        if not self._live:
            self.is_over = True
            return None
        self._live -= 1
        self._board.make()
        return Received(frame=encode_frame(self._board.made[self._board.boot_id][-1]))

    def ask_soon(self) -> None:
        pass

    def silent_s(self) -> float:
        return 0.0


def session(
    directory: Path,
    board: Board,
    seconds: float,
    fill: int = FILL,
    look: Callable[[], None] = lambda: None,
    settings: StationSettings = DEFAULTS,
) -> tuple[LiveRun, list[str]]:
    """`wayfix connect` for so many seconds of boat time; what it said. look: is called before each message."""
    said: list[str] = []
    link = SpoolLink(board, seconds, fill)

    def is_over() -> bool:
        look()
        return link.is_over

    with pytest.MonkeyPatch.context() as patched:
        for module in ("shore.live.run", "shore.logbook.background_writer"):
            patched.setattr(f"{module}.boottime_ns", lambda: 10**12 + board.t_ns)
        run = LiveRun(cast("Link", link), Options(settings, log_dir=directory), is_over, said.append)
        run.run()
    return run, said
