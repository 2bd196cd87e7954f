"""Trip account (run summary): what a live run was, in some lines, whether it kept a log or not."""

from collections import Counter
from collections.abc import Iterator
from datetime import timedelta
from typing import Any

from common.messages import Event
from common.words import counted
from shore.logbook.summary import TripSummary
from shore.logbook.why_none import WhyNone
from shore.watchers.watcher import Start, Step, Watcher


class RunAccount(Watcher):
    """Counts what it sees."""

    def __init__(self) -> None:
        self._trip = TripSummary()
        self._why_none = WhyNone()
        self._made: Counter[str] = Counter()
        self._aligned: Counter[str] = Counter()
        """Number of estimates that were valid, by filter."""
        self._parts: Counter[tuple[str, str]] = Counter()
        """Number of estimates whose `position`, or `heading`, was valid, by filter and part."""
        self._waiting: Counter[tuple[str, ...]] = Counter()
        """Number of frames after which the first filter lacked this."""
        self._roles: dict[str, str] = {}

    def begin(self, start: Start, t_ns: int) -> None:
        """Learn the sensors of the boat."""
        self._roles |= {sensor.id: sensor.role for sensor in start.config.sensor}

    def take(self, step: Step) -> None:
        """Count a frame and what it led to."""
        self._trip.frame(step.frame)
        self._why_none.frame(step.frame)
        if step.output.waiting:
            self._waiting[step.output.waiting] += 1
        for record in step.records:
            self._trip.estimate(record)
            self._made[record["filter"]] += 1
            self._aligned[record["filter"]] += bool(record["aligned"])
            self._parts.update((record["filter"], part) for part in record["aligned_parts"])
        for event in step.events:
            self._trip.event(event.level)

    def happened(self, event: Event, t_ns: int) -> None:
        """Count an event of the source."""
        self._trip.event(event.level)

    def as_record(self) -> dict[str, Any]:
        """The account for JSON; `why_no_estimates` is `None` where there are estimates."""
        trip = self._trip.as_record()
        shown = {name: trip[name] for name in ("seconds", "frames", "fixes", "distance_m", "max_sog_kn", "events")}
        why = None if self._made else self._why_none.text(self._roles)
        return {**shown, "estimates": dict(self._made), "aligned": dict(self._aligned), "why_no_estimates": why}

    def lines(self) -> Iterator[str]:
        """The account for people."""
        trip = self._trip.as_record()
        yield (
            f"trip    {timedelta(seconds=round(trip['seconds']))}, {counted(trip['frames'], 'frame')}, "
            f"{counted(trip['fixes'], 'usable fix', 'usable fixes')}"
        )
        if self._trip.has_place:
            yield f"sailed  {trip['distance_m']:,.0f} m, up to {trip['max_sog_kn']:.1f} kn"
        for name, count in self._made.items():
            valid = f"position valid in {self._parts[name, 'position']:,}, heading in {self._parts[name, 'heading']:,}"
            yield f"{name:7} {counted(count, 'estimate')}, {valid}"
        if not self._made:
            yield f"no estimates: {self._why_none.text(self._roles)}"
        elif not any(self._aligned.values()) and self._waiting:
            lacking, _ = self._waiting.most_common(1)[0]
            part = "none is valid" if not self._parts else "no heading is valid"
            yield f"{part}: the filters waited for {', '.join(lacking)}"
        if trip["events"]:
            yield f"events  {', '.join(f'{count} {level}' for level, count in trip['events'].items())}"
