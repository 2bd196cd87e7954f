"""The live run: link -> log (raw frame first) -> pipeline -> log (estimates, events), one status line a second."""

import logging
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.clock import boottime_ns
from common.codec import decode_frame
from common.errors import CodecError, LinkError, WayfixError
from common.events import event, line_of
from common.messages import Event, Frame
from common.sensors import BoatConfig
from common.settings import convert
from common.units import NS_PER_S
from shore.link import Link, Received
from shore.logbook.record import LogWriter
from shore.logbook.session import start_record
from shore.navigation.estimate import Estimate
from shore.pipeline import Pipeline
from shore.status import StatusLine

log = logging.getLogger(__name__)

RETRY_S = 2.0
"""How long one greeting is waited for while the link is lost; status and log go on in between."""


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


@dataclass(slots=True)
class Tally:
    """What became of the frames."""

    received: int = 0
    missing: int = 0
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


class Recorder:
    """The log of a live run, if one is wanted. A disk that fills up ends the log, never the run."""

    def __init__(self, directory: Path | None, boat_id: str, say: Callable[[str], None]) -> None:
        """Raises WayfixError when the directory cannot be written."""
        self.path: Path | None = None
        self.fault: WayfixError | None = None
        """Why the log ended before the run."""
        self._say = say
        self._writer: LogWriter | None = None
        if directory is not None:
            self._writer = LogWriter(directory, boat_id, time.time_ns())
            self.path = self._writer.path

    def write(self, action: Callable[[LogWriter], None]) -> None:
        """Do something with the writer, while there is one."""
        if self._writer is None:
            return
        try:
            action(self._writer)
        except WayfixError as error:
            self.fault = error
            self._say(f"error: log: {error}; the run goes on without a log")
            self._end()

    def close(self) -> None:
        """Close the log; safe to call twice."""
        self.write(LogWriter.close)
        self._writer = None

    def _end(self) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            with suppress(WayfixError):
                writer.close()


class LiveRun:
    """One station session from `connected` to its end. `say` prints a line for the person at the terminal."""

    def __init__(self, link: Link, options: Options, stopped: Callable[[], bool], say: Callable[[str], None]) -> None:
        """Connects at once; raises LinkError or WayfixError (unknown filter, log directory)."""
        self.tally = Tally()
        self._link = link
        self._options = options
        self._stopped = stopped
        self._say = say
        self._adopt(link.connect(stopped=stopped))
        self._next_seq: int = self.connected["next_seq"]
        self._boot_id = self.connected["boot_id"]
        self._recorder = Recorder(options.log_dir, self.config.boat.id, say)
        self._lost_since_ns: int | None = None
        self.broken = False
        """A bounded run ended because the link broke."""

    def _adopt(self, connected: dict[str, Any]) -> None:
        """Take the board's facts from its greeting; filters begin anew."""
        self.connected = connected
        self.config = convert(connected["config"], BoatConfig, "configuration of the board", strict=False)
        self._pipeline = Pipeline(self.config, self._options.filters, self._options.step_s)
        self._status = StatusLine(self.config, self._options.filters[0])

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
            self._write_session()
            if (trip := self._options.trip) is not None:
                self._recorder.write(lambda writer: writer.write_session(trip, time.time_ns()))
            for sensor in self.connected.get("sensors", []):
                reason = f": {sensor['reason']}" if sensor.get("reason") else ""
                self._say(f"{sensor.get('id')} {sensor.get('state')}{reason}")
            self._link.run(self._options.frames, self._options.period_s)
            while not self._stopped() and not self.broken:
                received = self._receive()
                if received is not None and received.end is not None:
                    self._ended(received.end)
                    break
                if received is not None and received.frame is not None:
                    self._take(received.frame)
                if boottime_ns() >= next_second_ns:
                    next_second_ns = max(next_second_ns + NS_PER_S, boottime_ns())
                    self._each_second()
        finally:
            end = {"kind": "end", **self._summary()}
            self._recorder.write(lambda writer: writer.write_session(end, time.time_ns()))
            self._recorder.close()
        return self.tally

    def _receive(self) -> Received | None:
        try:
            return self._link.receive(0.1)
        except CodecError as error:
            self.tally.bad += 1
            log.warning("message not understood: %s", error)
            return None

    def _take(self, data: bytes) -> None:
        now_ns = time.time_ns()
        try:
            frame = decode_frame(data)
        except CodecError as error:
            self.tally.bad += 1
            log.warning("frame not understood: %s", error)
            return
        self.tally.received += 1
        self._recorder.write(lambda writer: writer.write_frame(data, frame, now_ns))
        for happening in self._gap_events(frame):
            self._happened(happening, now_ns)
        output = self._pipeline.push(frame)
        for estimate in output.estimates:
            self._write_estimate(estimate, now_ns)
        for happening in (*frame.events, *output.events):
            self._happened(happening, now_ns)
        self._status.take(frame, output)

    def _gap_events(self, frame: Frame) -> Iterator[Event]:
        first_seq = frame.seq if frame.first_seq is None else frame.first_seq
        if frame.boot_id != self._boot_id:
            self._boot_id = frame.boot_id
            self._next_seq = 0  # what a new start of the board sent before we found it again
        if first_seq > self._next_seq and self._options.frames is None:
            count = first_seq - self._next_seq
            self.tally.missing += count
            yield event("frames-missing", frame.t1_ns, "link", count=count, seq=first_seq)
        self._next_seq = frame.seq + 1
        if self._lost_since_ns is not None:
            age_s = round((boottime_ns() - self._lost_since_ns) / NS_PER_S, 1)
            self._lost_since_ns = None
            yield event("link-restored", frame.t1_ns, "link", age_s=age_s)

    def _happened(self, happening: Event, now_ns: int) -> None:
        self._recorder.write(lambda writer: writer.write_event(happening, now_ns))
        if happening.level != "debug":
            self._say(f"{happening.level}: {line_of(happening)}")

    def _each_second(self) -> None:
        self._recorder.write(LogWriter.sync)
        silent_s = self._link.silent_s()
        if silent_s is None:
            self._say(self._counted())
            return
        if self._lost_since_ns is None:
            self._lost_since_ns = boottime_ns() - int(silent_s * NS_PER_S)
            lost = event("link-lost", self._status.t_ns, "link", age_s=round(silent_s, 1))
            self._happened(lost, time.time_ns())
            # A bounded run cannot be carried on without the board's spool: frames would be missing.
            self.broken = self._options.frames is not None
        if not self.broken:
            lost_s = (boottime_ns() - self._lost_since_ns) / NS_PER_S
            self._say(f"LINK LOST for {lost_s:.0f} s, trying again | before: {self._counted()}")
            self._begin_again()

    def _counted(self) -> str:
        return self._status.text(self.tally.received, self.tally.missing)

    def _begin_again(self) -> None:
        """Throw the socket away and greet anew; a restarted board or a new address is found like this."""
        with suppress(LinkError, CodecError):
            connected = self._link.connect(RETRY_S, self._stopped)
            if connected["config"] != self.connected["config"]:
                self._adopt(connected)
                self._write_session()
                self._happened(event("config-changed", self._status.t_ns, "link"), time.time_ns())
            self._link.run()

    def _ended(self, end: dict[str, Any]) -> None:
        self.tally.sent = int(end.get("sent") or 0)
        self.tally.end_reason = str(end.get("reason"))
        self._recorder.write(lambda writer: writer.write_link({"kind": "end", **end}, time.time_ns()))
        if self._options.frames is None:
            self.tally.missing += max(0, int(end.get("next_seq") or 0) - self._next_seq)

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
        return {
            "received": tally.received,
            "missing": tally.missing,
            "bad": tally.bad,
            "sent": tally.sent,
            "reason": tally.end_reason,
        }
