"""The live run: link -> log (raw frame first) -> pipeline -> log (estimates, events), one status line a second."""

import logging
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from common.clock import boottime_ns
from common.codec import decode_frame
from common.errors import CodecError, WayfixError
from common.events import event, line_of
from common.messages import Event
from common.sensors import BoatConfig
from common.session import BoundedRun
from common.settings import convert
from common.units import NS_PER_MS, NS_PER_S
from shore.link.choose_boat import Seeker
from shore.link.ledger import Ledger
from shore.link.link import CONNECT_TIMEOUT_S, Link, Received, Wants, endpoint
from shore.live.cursor import Cursor
from shore.live.status import StatusLine
from shore.logbook.recorder import Recorder
from shore.logbook.session import start_record
from shore.navigation.estimate import Estimate
from shore.pipeline import Pipeline

log = logging.getLogger(__name__)

SLOW_DISK_S: Final = 5.0
"""For one sync: a person is told."""


@dataclass(frozen=True, slots=True)
class Options:
    """What a live run was asked for."""

    filters: Sequence[str]
    frames: int | None = None
    period_s: float | None = None
    step_s: float | None = None
    log_dir: Path | None = None
    trip: dict[str, Any] | None = None
    """What a person calls it (`trip_record`)."""
    connect_s: float = CONNECT_TIMEOUT_S
    """The boat has so long to answer the greeting."""
    until_end: bool = False
    """The run is over when the daemon stops (a demo); else the station waits for it to come back."""


@dataclass(slots=True)
class Tally:
    """What became of the frames."""

    received: int = 0
    missing: int = 0
    """Asked for and not here, or not held by the boat any more."""
    repeated: int = 0
    """Came once more and were left out."""
    bad: int = 0
    sent: int | None = None
    """As the board's `end` says; None = no end was received."""
    end_reason: str | None = None


class StopFlag:
    """Set by Ctrl-C and SIGTERM; asked between frames, so that the log is always closed."""

    def __init__(self) -> None:
        self.reason: str | None = None

    def __call__(self) -> bool:
        """True once a signal came."""
        return self.reason is not None

    @contextmanager
    def on_signals(self) -> Iterator["StopFlag"]:
        """Catch SIGINT, SIGTERM and a closed terminal (SIGHUP) inside the block."""
        handled = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        previous = {number: signal.signal(number, self._catch) for number in handled}
        try:
            yield self
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)

    def _catch(self, number: int, _frame: object) -> None:
        self.reason = signal.Signals(number).name


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
        self._link = link
        self._options = options
        self._stopped = stopped
        self._say = say
        self._seeker = seeker
        # What is made while the filters are built comes in its order.
        self._adopt(link.connect(options.connect_s, stopped, stream=options.frames is None))
        is_kept = options.log_dir is not None and options.frames is None
        self._cursor = Cursor(options.log_dir, self.config.boat.id, say) if is_kept and options.log_dir else None
        self._ledger = self._cursor.ledger if self._cursor is not None else Ledger()
        self._recorder = Recorder(options.log_dir, self.config.boat.id, say)
        self._lost_since_ns: int | None = None
        self._is_filling = False
        self._is_disk_slow = False
        self._is_over = False
        self._next = (str(self.connected["boot_id"]), int(self.connected["next_seq"]))
        """The next frame of a bounded run."""
        link.wants = self._wants
        self._greet()

    def _adopt(self, connected: dict[str, Any]) -> None:
        """Take the board's facts from its greeting; filters begin anew."""
        self.connected = connected
        self.config = convert(connected["config"], BoatConfig, "configuration of the board", strict=False)
        self._pipeline = Pipeline(self.config, self._options.filters, self._options.step_s)
        self._status = StatusLine(self.config, self._options.filters[0])

    def _greet(self) -> None:
        """Learn from the greeting which frames there are."""
        runs = [(str(boot_id), int(first), int(upto)) for boot_id, _, first, upto in self.connected["runs"]]
        self._ledger.greet(str(self.connected["boot_id"]), int(self.connected["next_seq"]), runs)

    def _wants(self) -> Wants:
        """What the link's next lease asks for."""
        if self._options.frames is None:
            return Wants(missing=self._ledger.missing())
        return Wants(run=BoundedRun(self._options.frames, self.tally.received, *self._next, self._options.period_s))

    @property
    def _missing_count(self) -> int:
        """Frames still to come but for new ones; a bounded run has them in order, without a hole."""
        return 0 if self._options.frames is not None else self._ledger.missing_count

    @property
    def log_path(self) -> Path | None:
        """The log file, when one is written."""
        return self._recorder.path

    @property
    def log_fault(self) -> WayfixError | None:
        """Why the log ended before the run, if it did."""
        return self._recorder.fault

    def run(self) -> Tally:
        """Until the board's end, the asked number of frames, or a stop. Closes the log in any case."""
        next_second_ns = boottime_ns() + NS_PER_S
        try:
            self._begin()
            while not self._stopped() and not self._is_over:
                received = self._receive()
                if received is not None:
                    self._handle(received)
                if boottime_ns() >= next_second_ns:
                    self._each_second()
                    next_second_ns += NS_PER_S
                    if next_second_ns < boottime_ns():  # late: what waits comes first
                        next_second_ns = boottime_ns() + NS_PER_S
        finally:
            self.tally.missing = self._missing_count + self._ledger.gone_count
            if self._options.frames is not None:
                self.tally.missing = self._options.frames - self.tally.received
            end = {"kind": "end", **self._summary()}
            self._recorder.write(lambda writer: writer.write_session(end, time.time_ns()))
            self._keep(wait=True)
            self._recorder.close()
            if self._cursor is not None:
                self._cursor.close()
        return self.tally

    def _begin(self) -> None:
        self._write_session()
        self._keep()
        if (trip := self._options.trip) is not None:
            self._recorder.write(lambda writer: writer.write_session(trip, time.time_ns()))
        for sensor in self.connected.get("sensors", []):
            reason = f": {sensor['reason']}" if sensor.get("reason") else ""
            self._say(f"{sensor.get('id')} {sensor.get('state')}{reason}")
        if waiting := self._ledger.missing_count:
            self._say(f"{waiting} frames of before are fetched")

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
            self._greeted_anew(received.connected)
        elif received.end is not None:
            self._ended(received.end)
        for item in received.gone or ():
            if count := self._ledger.is_gone(item):
                self._happened(event("frames-gone", self._status.t_ns, "link", count=count, seq=item.first))

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
        self._link.is_urgent = self._link.is_urgent or self._ledger.has_hole
        self.tally.received += 1
        self._next = frame.boot_id, frame.seq + 1
        self._recorder.write(lambda writer: writer.write_frame(data, frame, now_ns))
        if self._lost_since_ns is not None:
            age_s = round((boottime_ns() - self._lost_since_ns) / NS_PER_S, 1)
            self._lost_since_ns = None
            self._happened(event("link-restored", frame.t1_ns, "link", age_s=age_s), now_ns)
        output = self._pipeline.push(frame)
        for estimate in output.estimates:
            self._write_estimate(estimate, now_ns)
        for happening in (*frame.events, *output.events):
            self._happened(happening, now_ns)
        self._status.take(frame, output)

    def _greeted_anew(self, connected: dict[str, Any]) -> None:
        """The daemon was started again."""
        if connected["config"] == self.connected["config"]:
            self.connected = connected
        else:
            self._adopt(connected)
            self._write_session()
            self._happened(event("config-changed", self._status.t_ns, "link"))
        self._greet()

    def _happened(self, happening: Event, now_ns: int | None = None) -> None:
        at_ns = time.time_ns() if now_ns is None else now_ns
        self._recorder.write(lambda writer: writer.write_event(happening, at_ns))
        if happening.level != "debug":
            self._say(f"{happening.level}: {line_of(happening)}")

    def _each_second(self) -> None:
        self._keep()
        self._tell_slow_disk()
        silent_s = self._link.silent_s()
        if silent_s is None:
            self._tell_filled()
            self._say(self._counted())
            return
        if self._lost_since_ns is None:
            self._lost_since_ns = boottime_ns() - int(silent_s * NS_PER_S)
            self._is_filling = True
            self._happened(event("link-lost", self._status.t_ns, "link", age_s=round(silent_s, 1)))
        lost_s = (boottime_ns() - self._lost_since_ns) / NS_PER_S
        refusal = f" ({self._link.refusal})" if self._link.refusal else ""
        self._say(f"LINK LOST for {lost_s:.0f} s{refusal}, trying again | before: {self._counted()}")
        address = None if self._seeker is None else self._seeker.ask()
        if address is not None and endpoint(address) != self._link.endpoint:
            self._say(f"the boat is at {address} now")
            self._link.move_to(address)

    def _tell_slow_disk(self) -> None:
        """Once, until the disk has caught up: a power cut now takes more of the log than a second."""
        is_slow = self._recorder.behind_s > SLOW_DISK_S
        if is_slow and not self._is_disk_slow:
            self._happened(event("log-behind", self._status.t_ns, "log", age_s=round(self._recorder.behind_s, 1)))
        self._is_disk_slow = is_slow

    def _tell_filled(self) -> None:
        """Once after a loss of the link: nothing is missing any more."""
        if self._is_filling and self._lost_since_ns is None and self._ledger.missing_count == 0:
            self._is_filling = False
            self._happened(event("gaps-filled", self._status.t_ns, "link", count=self.tally.received))

    def _keep(self, *, wait: bool = False) -> None:
        """The log to the disk, then the cursor that says so. One that cannot be written costs frames sent twice."""
        if self._cursor is None or self._recorder.path is None:
            self._recorder.sync(lambda: None, wait=wait)
        else:
            self._recorder.sync(self._cursor.saver(self._recorder.path, self._recorder.log_time_ns), wait=wait)

    def _counted(self) -> str:
        counts = self._status.text(self.tally.received, self._missing_count, self._ledger.gone_count)
        if self.log_fault is not None:
            counts = f"NO LOG | {counts}"
        offset = self._link.offset.at(boottime_ns())
        return counts if offset is None else f"{counts} | round trip {2 * offset.bound_ns / NS_PER_MS:.0f} ms"

    def _ended(self, end: dict[str, Any]) -> None:
        self.tally.sent = int(end.get("sent") or 0)
        self.tally.end_reason = str(end.get("reason"))
        self._ledger.exists(str(end.get("boot_id")), int(end.get("next_seq") or 0))
        self._recorder.write(lambda writer: writer.write_link({"kind": "end", **end}, time.time_ns()))
        self._is_over = self._options.until_end or self._options.frames is not None
        if not self._is_over:
            self._say(f"{self.tally.end_reason}; waiting for it to come back")

    def _write_estimate(self, estimate: Estimate, now_ns: int) -> None:
        self._recorder.write(lambda writer: writer.write_estimate(estimate.as_record(), now_ns))

    def _write_session(self) -> None:
        asked = {
            "filters": list(self._options.filters),
            "step_s": self._options.step_s,
            "frames": self._options.frames,
            "period_s": self._options.period_s,
        }
        now_ns = time.time_ns()
        record = start_record(self.connected, asked, now_ns)
        self._recorder.write(lambda writer: writer.write_session(record, now_ns))

    def _summary(self) -> dict[str, Any]:
        tally = self.tally
        offset = self._link.offset.at(boottime_ns())
        return {
            "clock_offset_ns": None if offset is None else offset.offset_ns,
            "clock_bound_ns": None if offset is None else offset.bound_ns,
            "received": tally.received,
            "missing": tally.missing,
            "bad": tally.bad,
            "sent": tally.sent,
            "reason": tally.end_reason,
        }
