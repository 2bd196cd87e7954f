"""Replay, a source of steps: the recorded frames through the same pipeline as live, in order of arrival or time.

    replay = Replay(Path("20261122T140055Z-springer.mcap"))
    replay.run(watchers)                    # or: for step in replay: ...
    replay.comparison.estimates.equal, replay.source.late

One pass; nothing of a step is kept.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

from common.events import is_of_station
from shore.logbook.arithmetic import arithmetic_here, arithmetic_of, unlike
from shore.logbook.foxglove import event_of
from shore.logbook.greetings import GREETED
from shore.logbook.log_reader import LogRecord, read_log
from shore.logbook.missing_frames import Census
from shore.logbook.schemas import ESTIMATES, EVENTS, LINK, SESSION
from shore.logbook.session import start_record
from shore.logbook.why_none import WhyNone
from shore.navigation.estimate import Estimate
from shore.pipeline import Output, Pipeline
from shore.replay.comparison import Comparison
from shore.replay.frames import Frames, Span
from shore.replay.smooth import smooth_log
from shore.watchers.watcher import SourceState, Start, Step, Watcher

KEPT_KINDS: Final = ("trip", "operator", GREETED)
"""Kinds of session records that a replay passes on."""
LONGEST_SLEEP_S: Final = 0.2


class Pace:
    """Lets a replay run at `speed` times the boat's time (real-time playback)."""

    def __init__(
        self,
        speed: float,
        now_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """now_s: a monotonic clock in seconds."""
        self._speed = speed
        self._now_s, self._sleep = now_s, sleep
        self._begun: tuple[float, float] | None = None
        """Clock reading (s) and seconds of the log at the first frame."""
        self._next_s = 0.0

    def wait_for(self, t_s: float, each_second: Callable[[], None]) -> None:
        """Wait until second `t_s` of the log is due, a late frame not at all; `each_second` is called once a second."""
        if self._begun is None:
            self._begun = self._now_s(), t_s
            self._next_s = self._begun[0] + 1.0
        due_s = self._begun[0] + (t_s - self._begun[1]) / self._speed
        while True:
            now_s = self._now_s()
            if now_s >= self._next_s:
                self._next_s = max(self._next_s + 1.0, now_s)
                each_second()
            if now_s >= due_s:
                return
            self._sleep(min(due_s - now_s, self._next_s - now_s, LONGEST_SLEEP_S))


class Replay:
    """One replay of a log: iterate over it once, then read what was counted."""

    def __init__(
        self,
        path: Path,
        filters: Sequence[str] | None = None,
        step_s: float | None = None,
        order: str = "arrival",
        span: Span | None = None,
        *,
        inject: Sequence[str] = (),
    ) -> None:
        """Filters and step default to those of the live run; a step of 0 is none at all.

        inject: faults of sensors that the log did not have (`common/simulation/fault_text.py`).
        Raises WayfixError: no log, no configuration, filters, faults.
        """
        self.reader = read_log(path)
        self.source = Frames(self.reader, order, span, inject)
        options = self.source.start.options
        live, live_step_s = tuple(options.get("filters") or ()), options.get("step_s")
        self.filters = tuple(filters or live)
        self.step_s = live_step_s if step_s is None else step_s or None
        self.order = order
        self.inject = tuple(inject)
        self.frames = 0
        self.estimates = 0
        self._why_none = WhyNone()
        self.why_not: str | None = None
        """Why nothing is compared with what was recorded; `None` = it is compared."""
        if inject:
            self.why_not = "faults are injected that the live run did not have"
        elif order == "time":
            self.why_not = "no live run could have made estimates in order of boat time"
        elif options.get("begun_again"):
            self.why_not = f"the log began in the middle of its run, when {options['begun_again']} was removed"
        elif self.step_s != live_step_s:
            self.why_not = "the step is another"
        elif span is not None and span.from_s:
            self.why_not = "the filters began at --from"
        elif not set(self.filters) & set(live):
            self.why_not = "other filters ran"
        self.other_arithmetic = unlike(arithmetic_of(self.start.record), arithmetic_here())
        """What is to be said of the log's arithmetic, without the subject; `None` = it is ours."""
        both = tuple(name for name in self.filters if name in live)
        self.comparison: Comparison | None = None
        if self.why_not is None:
            self.comparison = Comparison(
                both,
                self.reader.content,
                events=self.filters == live,
                same_arithmetic=self.other_arithmetic is None,
            )
        self._pipeline = self._new_pipeline(self.source.start)
        self._passed: list[LogRecord] = []

    @property
    def start(self) -> Start:
        """The session record at the beginning of the log."""
        return self.source.start

    @property
    def why_none(self) -> str | None:
        """Why no filter made an estimate; `None` = one did. Complete after the last frame."""
        if self.estimates:
            return None
        if not self.filters:
            return "no filter was asked for"
        return self._why_none.text({sensor.id: sensor.role for sensor in self.start.config.sensor})

    @property
    def differs(self) -> bool:
        """True when what was compared is not as recorded; where frames are lost to damage, that is no difference."""
        return self.comparison is not None and self.comparison.differs and self.damage is None

    @property
    def damage(self) -> str | None:
        """Why the log ends early, if it does; complete after the last frame."""
        return self.reader.damage

    def __iter__(self) -> Iterator[Step]:
        start = self.start
        estimates = [f"{ESTIMATES}{name}" for name in self.filters] if self.comparison else []
        for item in self.source.read(EVENTS, LINK, *estimates):
            if isinstance(item, LogRecord):
                self._beside(item)
                continue
            if item.start is not start:
                # A board that came back with another configuration: the live run began again there.
                start, self._pipeline = item.start, self._new_pipeline(item.start)
            step = Step.of(item, self._pipeline.push(item.frame) if item.is_live else Output(is_past=True))
            self.frames += 1
            self._why_none.frame(item.frame)
            self.estimates += len(step.records)
            if self.comparison:
                self.comparison.take(step)
            yield step
        if self.comparison:
            self.comparison.finish()

    def run(self, watcher: Watcher, pace: Pace | None = None) -> None:
        """All steps to a watcher, and what the log says beside them that no replay makes. No frame, no `end`.

        pace: as fast as it can without one, and then no `each_second`.
        """
        start: Start | None = None
        census, t_ns = Census(), 0

        def each_second() -> None:
            if start is not None:
                watcher.each_second(SourceState(census.count, sum(census.holes(0))))

        for step in self:
            if pace is not None:
                pace.wait_for(step.t_s, each_second)
                census.frame(step.frame)
            t_ns = step.log_time_ns
            if step.start is not start:
                start = step.start
                watcher.begin(self._as_replayed(start, t_ns), t_ns)
            self._pass_on(watcher, t_ns)
            watcher.take(step)
        if start is not None:
            self._pass_on(watcher, t_ns)
            watcher.end({"received": self.frames, "reason": "replayed", "damage": self.damage}, t_ns)

    def _pass_on(self, watcher: Watcher, t_ns: int) -> None:
        for record in self._passed:
            watcher.note(record.topic, record.json(), min(record.log_time_ns, t_ns))
        self._passed.clear()

    def _as_replayed(self, start: Start, t_ns: int) -> Start:
        """The session as a new log says it: which filters ran now, and over which log."""
        asked = {
            **{name: value for name, value in start.options.items() if name != "settings"},  # the live run's own
            "filters": list(self.filters),
            "step_s": self.step_s,
            "order": self.order,
            "replayed_from": self.reader.path.name,
            **({"inject": list(self.inject)} if self.inject else {}),
        }
        record = start_record(start.record["connected"], asked, start.record.get("utc_ns", t_ns))
        return Start(record, start.config)

    def _new_pipeline(self, start: Start) -> Pipeline:
        return Pipeline(start.config, self.filters, self.step_s, starts=self.source.starts)

    def _beside(self, record: LogRecord) -> None:
        if record.topic.startswith(ESTIMATES):
            if self.comparison:
                self.comparison.estimate(record)
        elif (content := self.reader.content(record)) is not None and self._is_passed(record.topic, content):
            self._passed.append(record)

    def _is_passed(self, topic: str, content: dict[str, Any]) -> bool:
        if topic == SESSION:
            return content["kind"] in KEPT_KINDS
        if topic == LINK:
            return self.order == "arrival"
        event = event_of(content)
        if self.comparison:
            self.comparison.event(event)
        return self.order == "arrival" and is_of_station(event["code"])


def smoothed(path: Path, name: str, span: Span | None = None, inject: Sequence[str] = ()) -> Iterator[Estimate]:
    """The log's track by filter `name` with every estimate knowing the whole log; frames in order of boat time.

    All states of a session are in memory at once. Raises: WayfixError for a log without configuration or an unknown
    filter.
    """
    arrivals = Frames(read_log(path), "time", span, inject)
    for start, group in groupby(arrivals, key=attrgetter("start")):
        yield from smooth_log(start.config, (arrival.frame for arrival in group), name)
