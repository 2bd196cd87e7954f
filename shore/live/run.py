"""Live run, a source of steps: link -> pipeline -> watchers (log, events, status line)."""

import logging
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.boat_config import BoatConfig
from common.boat_start import StartOrder, boots_named
from common.clock import boottime_ns
from common.codec import decode_frame
from common.errors import CodecError, WayfixError
from common.events import event
from common.link_messages import BoundedRun
from common.messages import Event
from common.settings import convert
from common.units import NS_PER_MS, NS_PER_S
from shore.link.catching_up import Backfill
from shore.link.choose_boat import Seeker
from shore.link.frame_ledger import MAX_STARTS, Ledger
from shore.link.link import CONNECT_TIMEOUT_S, Link, Received, Wants, endpoint
from shore.live.busy_watch import BusyWatch
from shore.live.cursor import Cursor
from shore.live.ledger_from_logs import take_frames
from shore.live.link_loss import LinkLoss
from shore.live.log import LiveLog
from shore.live.tally import Tally
from shore.logbook.greetings import greeted_record
from shore.logbook.holes import count_listed
from shore.logbook.schemas import LINK, SESSION
from shore.logbook.session import start_record
from shore.pipeline import Output, Pipeline
from shore.settings.station import DEFAULTS, StationSettings
from shore.watchers.account import RunAccount
from shore.watchers.say import SayEvents
from shore.watchers.status import StatusLine
from shore.watchers.watcher import Arrival, BoardNow, RunSeconds, SourceState, Start, Step, Watchers

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Options:
    """What a live run was asked for."""

    settings: StationSettings = DEFAULTS
    frames: int | None = None
    period_s: float | None = None
    log_dir: Path | None = None
    trip: dict[str, Any] | None = None
    """Name, place and note of the trip (`trip_record`); `None` = none was given."""
    connect_s: float = CONNECT_TIMEOUT_S
    """Time-out of the greeting, s."""
    until_end: bool = False
    """True = the run is over when the daemon stops (a demo); False = the station waits for it to come back."""


class LiveRun:
    """One station session from `connected` to its end. `say` prints a line for the person at the terminal."""

    def __init__(
        self,
        link: Link,
        options: Options,
        stopped: Callable[[], bool],
        say: Callable[[str], None],
        seeker: Seeker | None = None,
    ) -> None:
        """Connects at once; raises LinkError or WayfixError (unknown filter, log directory).

        seeker: is asked for another address while the link is lost.
        """
        self.tally = Tally()
        self._starts = StartOrder()
        self._link = link
        self._options = options
        self._stopped = stopped
        self._say = say
        self._seeker = seeker
        # What is made while the filters are built comes in its order.
        self._adopt(link.connect(options.connect_s, stopped, stream=options.frames is None, wants=self._wants))
        boat_id, directory = self._config.boat.id, options.log_dir
        cursor = Cursor(directory, boat_id, say) if directory is not None and options.frames is None else None
        self._ledger = Ledger() if cursor is None else cursor.ledger
        self._log = LiveLog(directory, boat_id, cursor, say)
        self._trip = None if cursor is None or self._log.path is None else self._log.path.name
        """Name of this trip in the ledger; `None` = no trip is told from another."""
        self._backfill = Backfill()
        self._has_newest = False
        """Whether the newest frame has come since the board greeted or was silent. Older ones are not asked for before:
        beside it they find their age, and what is older than the horizon starts no filter."""
        settings = options.settings
        rate = float(self._connected.get("clock_rate") or 1.0)
        self._status = StatusLine(settings.filter.names[0], say, settings, boat_seconds_per_s=rate)
        self.account = RunAccount()
        """What the run was, so far."""
        self._watchers = Watchers(self._log, SayEvents(say, settings), self._status, self.account)
        self._loss = LinkLoss()
        self._seconds = RunSeconds()
        self._is_disk_slow = False
        self._is_over = False
        self._next = (str(self._connected["boot_id"]), int(self._connected["next_seq"]))
        """The next frame of a bounded run: (boot_id, seq)."""
        self._greet()

    @property
    def log_path(self) -> Path | None:
        """The log file, when one is written."""
        return self._log.path

    @property
    def log_fault(self) -> WayfixError | None:
        """Why the log ended before the run, if it did."""
        return self._log.fault

    def run(self) -> Tally:
        """Run until the board's end, the number of frames asked for, or a stop. The log is closed in any case."""
        watch = BusyWatch(self._say)
        try:
            self._begin()
            with watch.watching():
                self._go_on(watch.beat)
        finally:
            self.tally.missing = self.missing_count
            if self._options.frames is not None:
                self.tally.missing = self._options.frames - self.tally.received
            self._watchers.end(self._end_record(), time.time_ns())
        return self.tally

    def _go_on(self, beat: Callable[[], None]) -> None:
        next_second_ns = boottime_ns() + NS_PER_S
        while not self._stopped() and not self._is_over:
            beat()
            received = self._receive()
            if received is not None:
                self._handle(received)
            if boottime_ns() >= next_second_ns:
                self._each_second()
                next_second_ns += NS_PER_S
                if next_second_ns < boottime_ns():  # late: what waits comes first
                    next_second_ns = boottime_ns() + NS_PER_S

    def _adopt(self, connected: dict[str, Any]) -> None:
        """Take the board's facts from its greeting; the filters start again."""
        self._connected = connected
        self._config = convert(connected["config"], BoatConfig, "configuration of the board", strict=False)
        asked = self._options.settings.filter
        self._pipeline = Pipeline(self._config, asked.names, asked.step_s, starts=self._starts)

    def _begin_session(self) -> None:
        """What comes from here on belongs to the configuration that was adopted last."""
        options, now_ns = self._options, time.time_ns()
        asked = {
            **options.settings.as_options("limits", "display"),
            "frames": options.frames,
            "period_s": options.period_s,
        }
        record = {**start_record(self._connected, asked, now_ns), "since": self._ledger.since}
        self._start = Start(record, self._config)
        self._watchers.begin(self._start, now_ns)

    def _greet(self) -> None:
        """Learn from the greeting which frames there are."""
        runs = [(str(boot_id), int(first), int(upto)) for boot_id, _, first, upto in self._connected["runs"]]
        boot_id, next_seq = str(self._connected["boot_id"]), int(self._connected["next_seq"])
        self._starts.greeted(boots_named(self._connected["runs"]))
        before = self._ledger.forgotten
        self._wants_older = self._ledger.greet(boot_id, next_seq, runs)
        self._forgotten = self._ledger.forgotten - before
        if self._trip is not None:
            self._ledger.begin_trip(boot_id, next_seq, self._trip)
        self._has_newest = False

    def _tell_lost(self) -> None:
        """Say which starts cannot be asked for: forgotten by spool or ledger, or not in the greeting."""
        starts, unlisted = self._connected.get("unlisted") or (0, 0)
        for count, reason in (
            (unlisted * self._wants_older, f"the boat holds {starts} more starts of its daemon than it lists"),
            (self._forgotten, f"this station has forgotten starts of the daemon before the newest {MAX_STARTS}"),
        ):
            if count:
                self.tally.lost += count
                self._happened(event("starts-lost", self.t_ns, "link", reason=reason, count=count))
        if self._wants_older and not starts:
            reason = "the boat holds no start of its daemon that this station knows"
            self._happened(event("starts-lost", self.t_ns, "link", reason=reason, count="nobody knows how many"))

    def _wants(self) -> Wants:
        """What the link's next lease asks for."""
        if self._options.frames is None:
            return Wants(missing=self._ledger.missing() if self._has_newest else ())
        return Wants(run=BoundedRun(self._options.frames, self.tally.received, *self._next, self._options.period_s))

    @property
    def missing_count(self) -> int:
        """Number of frames still to come, new ones left out; a bounded run has them in order, without a hole."""
        return 0 if self._options.frames is not None else self._ledger.missing_count

    def _begin(self) -> None:
        self._begin_session()
        if (trip := self._options.trip) is not None:
            self._watchers.note(SESSION, trip, time.time_ns())
        self._tell_lost()
        for sensor in self._connected.get("sensors", []):
            reason = f": {sensor['reason']}" if sensor.get("reason") else ""
            self._say(f"{sensor.get('id')} {sensor.get('state')}{reason}")

    def _receive(self) -> Received | None:
        try:
            return self._link.receive(0.1)
        except CodecError as error:
            self.tally.bad += 1
            log.warning("message not understood: %s", error)
            return None

    def _handle(self, received: Received) -> None:
        if received.frame is not None:
            self._take(received.frame)
        elif received.connected is not None:
            self._greeted_again(received.connected)
        elif received.end is not None:
            self._ended(received.end)
        for item in received.gone or ():
            if count := self._ledger.is_gone(item):
                self.tally.lost += count
                self._happened(event("frames-gone", self.t_ns, "link", count=count, seq=item.first))

    def _take(self, data: bytes) -> None:
        now_ns = time.time_ns()
        try:
            frame = decode_frame(data)
        except CodecError as error:
            self.tally.bad += 1
            log.warning("frame not understood: %s", error)
            return
        if not self._ledger.take(frame.boot_id, frame.first, frame.seq):
            self.tally.repeated += 1
            return
        if self._ledger.has_hole:
            self._link.ask_soon()
        is_again = self._pipeline.has(frame)
        self.tally.received += not is_again
        self.tally.not_stored += self.log_fault is not None
        self._next = frame.boot_id, frame.seq + 1
        self._has_newest = self._has_newest or self._ledger.is_newest(frame.boot_id, frame.seq)
        self._backfill.take(frame)
        trip = self._ledger.trip_of(frame.boot_id, frame.seq)
        if trip is not None and trip != self._trip:
            self._log.complete(trip, Arrival(data, frame, self._start, now_ns))
            return
        if is_again:  # for a log that was begun again
            self._log.take(Step.of(Arrival(data, frame, self._start, now_ns), Output()))
            return
        arrival = Arrival(data, frame, self._start, now_ns, self._seconds.at(frame))
        try:
            step = Step.of(arrival, self._pipeline.push(frame))
        except BaseException:
            self._watchers.take(Step.of(arrival, Output()))  # the log holds the frame that the filters broke on
            raise
        if self._loss.is_lost:
            self._happened(self._loss.frame(boottime_ns(), frame.t1_ns), now_ns)
        self._watchers.take(step)

    def _greeted_again(self, connected: dict[str, Any]) -> None:
        """The daemon was restarted, and has greeted again."""
        if connected["config"] == self._connected["config"]:
            self._connected = connected
            self._watchers.note(SESSION, greeted_record(connected), time.time_ns())
        else:
            self._adopt(connected)
            self._begin_session()
            self._happened(event("config-changed", self.t_ns, "link"))
        self._greet()
        self._tell_lost()

    @property
    def t_ns(self) -> int:
        """Boat time of the newest frame of this session; 0 before the first."""
        return 0 if self._status.newest is None else self._status.newest.t_ns

    def _happened(self, happening: Event | None, now_ns: int | None = None) -> None:
        if happening is not None:
            self._watchers.happened(happening, time.time_ns() if now_ns is None else now_ns)

    @property
    def _wants_another_log(self) -> bool:
        """A bounded run asks for no frame twice: behind a fault another log would hide what is in none."""
        return self._log.is_gone if self._trip is None else self._log.wants_another

    def _begin_log_again(self) -> None:
        """The log was removed, or its disk failed: another one begins, and what is in no log comes once more."""
        assert self._log.path is not None
        before, is_gone, now_ns = self._log.path, self._log.is_gone, time.time_ns()
        record = {**self._start.record, "options": {**self._start.options, "begun_again": before.name}}
        following = None if is_gone else self._ledger.next
        if following is not None:  # its trip begins here
            record["connected"] = {**self._connected, "boot_id": following[0], "next_seq": following[1]}
        gone = self._log.begin_again(Start(record, self._config), now_ns)
        if self.log_fault is not None:
            return
        self._watchers.note(SESSION, greeted_record(self._connected), now_ns)
        self.tally.not_stored = self.tally.received if self._trip is None else 0  # else they come once more
        code = "log-gone" if is_gone else "log-again"
        self._happened(event(code, self.t_ns, "log", file=str(before), new=str(self._log.path)), now_ns)
        if self._trip is None:
            return
        if is_gone:
            self._ledger.rename_trip(self._trip, self._log.path.name)
        for trip in (self._log.path.name if is_gone else self._trip, *gone):
            self._ledger.forget_trip(trip)
        if following is not None:
            with suppress(WayfixError):  # what it holds is not asked for, and what comes late goes beside it
                take_frames(self._ledger, before, 0, self._config.boat.id)
            self._ledger.begin_trip(*following, self._log.path.name)
        self._trip = self._log.path.name
        for item in self._log.held_late:  # written since, before it was seen that their trip is gone
            self._ledger.take(item.boot_id, item.first, item.last)

    def _each_second(self) -> None:
        if self._wants_another_log:
            self._begin_log_again()
        self._log.checkpoint()  # first: a fault of the disk belongs into this second's line
        limits = self._options.settings.limits
        is_slow = self._log.behind_s > limits.log_behind_s
        if is_slow and not self._is_disk_slow:  # once, until the disk has caught up
            self._happened(event("log-behind", self.t_ns, "log", age_s=round(self._log.behind_s, 1)))
        self._is_disk_slow = is_slow
        silent_s, now_ns = self._link.silent_s(), boottime_ns()
        is_lost = silent_s > limits.link_lost_s
        if not is_lost:
            self._happened(self._loss.heard(self._ledger.missing_count, self.tally.received, self.t_ns))
        else:
            self._has_newest = False
            self._happened(self._loss.silent(silent_s, now_ns, self.t_ns))
        self._watchers.each_second(self._state(self._loss.lost_s(now_ns) if is_lost else None))
        if is_lost:
            self._follow()

    def _follow(self) -> None:
        """Move to another address that a lost boat may have by now."""
        address = None if self._seeker is None else self._seeker.ask()
        if address is not None and endpoint(address) != self._link.endpoint:
            self._say(f"the boat is at {address} now")
            self._link.move_to(address)

    def _board_now(self, now_ns: int) -> BoardNow | None:
        """The board's clock; one that a virtual board scales has not what round trips measure."""
        clock_id, offset = self._connected.get("clock_id"), self._link.offset.at(now_ns)
        if not isinstance(clock_id, str):
            return None
        is_scaled = self._connected.get("clock_rate", 1.0) != 1.0
        return BoardNow(clock_id, None if offset is None or is_scaled else now_ns + offset.offset_ns - offset.bound_ns)

    def _state(self, lost_s: float | None) -> SourceState:
        now_ns = boottime_ns()
        offset = self._link.offset.at(now_ns)
        return SourceState(
            received=self.tally.received,
            missing=self.missing_count,
            catching_up=self._backfill.missing(self._ledger.all_missing(), now_ns),
            lost=self.tally.lost,
            lost_s=lost_s,
            refusal=None if lost_s is None else self._link.refusal,
            round_trip_ms=None if offset is None else 2 * offset.bound_ns / NS_PER_MS,
            has_log=self.log_fault is None,
            not_stored=self.tally.not_stored,
            board_now=self._board_now(now_ns),
        )

    def _ended(self, end: dict[str, Any]) -> None:
        self.tally.sent = int(end.get("sent") or 0)
        self.tally.end_reason = str(end.get("reason"))
        self._ledger.exists(str(end.get("boot_id")), int(end.get("next_seq") or 0))
        self._watchers.note(LINK, {"kind": "end", **end}, time.time_ns())
        self._is_over = self._options.until_end or self._options.frames is not None
        if not self._is_over:
            self._say(f"{self.tally.end_reason}; waiting for it to come back")

    def _holes_of(self, trip: str) -> dict[str, Any]:
        """What of this trip is still to come and what is lost, and how many frames are of those before it."""
        record = self._ledger.holes_of(trip)
        missing, lost = (count_listed(record, word) for word in ("lacks", "lost"))
        before = {"lacking_before": self._ledger.missing_count - missing, "lost_before": self.tally.lost - lost}
        return {**record, **before}

    def _end_record(self) -> dict[str, Any]:
        tally = self.tally
        offset = self._link.offset.at(boottime_ns())
        return {
            "clock_offset_ns": None if offset is None else offset.offset_ns,
            "clock_bound_ns": None if offset is None else offset.bound_ns,
            "received": tally.received,
            "missing": tally.missing,
            **({} if self._trip is None else self._holes_of(self._trip)),
            "bad": tally.bad,
            "sent": tally.sent,
            "reason": tally.end_reason,
        }
