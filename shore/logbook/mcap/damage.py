"""Damage report of a log file: which records are lost, and which damage costs none."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from typing import Any

from common.units import NS_PER_S
from common.words import counted


@dataclass(frozen=True, slots=True)
class Loss:
    """A stretch of a log without its records."""

    first_byte: int
    end_byte: int
    start_ns: int | None
    """Log time at which the stretch begins (arrival, UTC, ns); `None` = at the beginning of the log."""
    end_ns: int | None
    """Log time at which the stretch ends, ns; `None` = not known, because the log ends here."""
    is_exact: bool
    """True = these are the times of the first and last lost record; False = of the records kept before and behind
    them."""
    records: int | None
    """Number of lost records; `None` = not known."""
    reason: str

    @property
    def seconds(self) -> float | None:
        """Length of the span, s."""
        known = self.start_ns is not None and self.end_ns is not None
        return (self.end_ns - self.start_ns) / NS_PER_S if known else None  # type: ignore[operator]

    def as_record(self) -> dict[str, Any]:
        """The loss for JSON."""
        return {**asdict(self), "seconds": self.seconds, "start_utc": iso(self.start_ns), "end_utc": iso(self.end_ns)}

    def __str__(self) -> str:
        how_many = "an unknown number of records" if self.records is None else counted(self.records, "record")
        is_empty = self.first_byte == self.end_byte
        where = f"at byte {self.first_byte}" if is_empty else f"bytes {self.first_byte} to {self.end_byte}"
        return f"{how_many} lost {self.when}, {where}: {self.reason}"

    @property
    def when(self) -> str:
        """The span in words."""
        start, end = clock(self.start_ns), clock(self.end_ns)
        if self.end_ns is None:
            return f"after {start}" if self.start_ns is not None else "from the beginning"
        if self.start_ns is None:
            return f"from the beginning to {end}"
        word, join = ("from", "to") if self.is_exact else ("between", "and")
        return f"{word} {start} {join} {end} ({self.seconds:.1f} s)"


@dataclass(frozen=True, slots=True)
class Flaw:
    """Damage that costs no record."""

    first_byte: int
    end_byte: int
    what: str

    def as_record(self) -> dict[str, Any]:
        """The flaw for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.what}, no record lost (bytes {self.first_byte} to {self.end_byte})"


@dataclass(frozen=True, slots=True)
class AnotherLog(Flaw):
    """A log that was put behind this one (`cat a b`), and is not read."""

    def __str__(self) -> str:
        first = self.first_byte
        return f"another log begins at byte {first}, which is not read (`tail -c +{first + 1} LOG > NEW` takes it out)"


@dataclass(slots=True)
class Part:
    """One unreadable stretch while it is not yet known what stands behind it."""

    first_byte: int
    end_byte: int
    reason: str
    span_ns: tuple[int, int] | None = None
    """First and last log time, ns, from the chunk's own head or from the index of the file."""
    times_ns: list[int] = field(default_factory=list)
    """Log times, ns, from the message indexes behind a chunk whose length is intact."""
    is_counted: bool = True
    """True when all of these indexes are sound."""

    def span(self, before_ns: int | None, after_ns: int | None) -> tuple[int, int] | None:
        """First and last log time, where what is known of them agrees."""
        if self.span_ns is None:
            return None
        start, end = self.span_ns
        if self.times_ns and self.is_counted:
            return self.span_ns if (min(self.times_ns), max(self.times_ns)) == self.span_ns else None
        is_between = (before_ns is None or before_ns <= start) and (after_ns is None or end <= after_ns)
        return self.span_ns if start <= end and is_between else None


def loss_of(parts: list[Part], before_ns: int | None, after_ns: int | None, *, is_end: bool) -> Loss:
    """Neighbouring parts as one loss. before, after: log time of the records kept around; is_end: the log ends here."""
    spans = [part.span(before_ns, after_ns) for part in parts]
    known = [span for span in spans if span is not None]
    counts = [len(part.times_ns) if part.is_counted else 0 for part in parts]
    is_exact = len(known) == len(parts) and not is_end
    start_ns, end_ns = before_ns, after_ns
    if is_exact:
        start_ns, end_ns = min(start for start, _ in known), max(end for _, end in known)
    return Loss(
        first_byte=parts[0].first_byte,
        end_byte=parts[-1].end_byte,
        start_ns=start_ns,
        end_ns=None if is_end else end_ns,
        is_exact=is_exact,
        records=sum(counts) if all(counts) and not is_end else None,
        reason="; ".join(dict.fromkeys(part.reason for part in parts)),
    )


def all_named(losses: list[Loss], whole: Loss) -> list[Loss]:
    """The losses of a log that misses `whole.records`: the open one gets its count, or `whole` is one more."""
    unnamed = (whole.records or 0) - sum(loss.records or 0 for loss in losses)
    open_ones = [loss for loss in losses if loss.records is None]
    if unnamed <= 0 or len(open_ones) > 1:
        return losses
    if not open_ones:
        return [*losses, replace(whole, records=unnamed)]
    return [replace(loss, records=unnamed) if loss.records is None else loss for loss in losses]


def sentence(losses: Iterable[Loss], flaws: Iterable[Flaw], cut: Loss | None, *, is_being_written: bool) -> str | None:
    """All that is wrong in one sentence; `None` when nothing is."""
    words = []
    if is_being_written:
        words.append("the log is being written right now, read up to its last whole chunk")
    elif cut is not None:
        what = f"what came after {clock(cut.start_ns)}" if cut.start_ns is not None else "all of it"
        words.append(f"the log was not closed (crash or power cut): {what} is lost ({cut.reason})")
    words += _first_of([str(loss) for loss in losses], "losses")
    words += _first_of([str(flaw) for flaw in flaws], "flaws")
    return "; ".join(words) or None


def _first_of(told: list[str], kind: str) -> list[str]:
    return told if len(told) <= 3 else [*told[:2], f"and {len(told) - 2} more {kind} (wayfix log verify)"]


def clock(utc_ns: int | None) -> str:
    """A UTC time for people."""
    text = iso(utc_ns)
    return "?" if text is None else text.replace("T", " ").replace("Z", " UTC")


def iso(utc_ns: int | None) -> str | None:
    """A UTC time with milliseconds; a plain number where no calendar date exists for it."""
    if utc_ns is None:
        return None
    try:
        moment = datetime.fromtimestamp(utc_ns // NS_PER_S, UTC)
    except (ValueError, OverflowError, OSError):
        return f"{utc_ns} ns"
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{utc_ns % NS_PER_S // 10**6:03d}Z"
