"""Time columns of a table: the form of texts and the unit of numbers, by trying them (format inference)."""

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

from common.simulation.column_map import TimeColumn
from common.units import NS_PER_S
from shore.imports.cells import is_nothing, with_point
from shore.imports.guess_names import candidates, plain
from shore.imports.line_counts import Rejected
from shore.imports.table_file import TableFile
from shore.imports.time_cells import TimeCells

_DATES: Final = (
    "%Y-%m-%d", "%Y/%m/%d", "%Y.%m.%d", "%d.%m.%Y", "%d.%m.%y", "%d/%m/%Y", "%m/%d/%Y", "%d/%m/%y", "%m/%d/%y",
    "%d-%m-%Y", "%d-%b-%Y", "%d-%b-%y", "%d %b %Y", "%b %d %Y", "%Y%m%d", "%d%m%y", "%y%m%d",
)  # fmt: skip
_TIMES: Final = ("%H:%M:%S", "%H:%M:%S:%f", "%I:%M:%S %p", "%H:%M", "%I:%M %p", "%H%M%S", "%H.%M.%S")
_LEAST_SHARE: Final = 0.9
"""Share of the rows that a form must fit."""
_EPOCHS: Final = ((3e17, 1e-9), (3e14, 1e-6), (3e11, 1e-3), (3e8, 1.0))
"""Smallest number since 1970 in each unit, and the seconds in it."""
_NANOSECONDS: Final = re.compile(r"\b(nsecs?|nanosecs?|nanoseconds)$")
_CLOCK: Final = re.compile(r"[0-2][0-9][0-5][0-9][0-5][0-9](\.[0-9]*)?")
"""A time of day without anything between its parts: 100800.00."""
_AMERICAN: Final = re.compile(r"^[1-9]/|/[1-9]/|[AP]M$")
_EXCEL: Final = (20_000.0, 80_000.0)
"""Days of Excel from 1954 to 2119."""


class TimeGuess(NamedTuple):
    """The table `[time]` of a proposal."""

    keys: dict[str, Any]
    unsure: dict[str, str]
    """A comment for a person on each key that is not sure."""


def time_of(file: TableFile, *, by_name: bool = True) -> TimeGuess | None:
    """What the time of a table is; `None` = no column looks like one. by_name: False = names say nothing."""
    named = candidates(file.table.columns, "time") if by_name else list(file.table.columns)
    numbers = [(column, values) for column in named if (values := _numbers(file, column))]
    for column, values in numbers:
        if (guess := _since_1970(file, column, values)) is not None:
            return guess
    for column in named:
        if (guess := _text(file, column, named)) is not None:
            return guess
    for column, values in numbers:
        if all(_EXCEL[0] < value < _EXCEL[1] for value in values) and "." in _texts(file, column)[0].replace(",", "."):
            unsure = {"utc": "is it UTC? Excel keeps local time as it was shown"}
            return TimeGuess({"column": column, "excel": True, "utc": True}, unsure)
    for column, values in numbers:
        if len(values) > 1 and sum(b >= a for a, b in pairwise(values)) > _LEAST_SHARE * (len(values) - 1):
            return _counted(file, column, values)
    return None


def _text(file: TableFile, column: str, named: Sequence[str]) -> TimeGuess | None:
    texts = _texts(file, column)
    if not texts:
        return None
    if all(map(_is_number, texts)) and not _is_packed_date(file, column):
        return _time_of_day(file, column) if all(map(_CLOCK.fullmatch, texts)) else None
    if _fits(file, {"column": column, "format": "iso"}):
        has_zone = texts[0].rstrip()[-1:] in ("Z", "C") or "+" in texts[0]
        unsure = {} if has_zone or _says_utc(column) else {"utc": "is it UTC? else utc = false"}
        return TimeGuess({"column": column, "format": "iso", "utc": True}, unsure)
    fitting: list[tuple[dict[str, Any], str]] = []
    others = [name for name in named if name != column and _texts(file, name)]
    for date in _DATES:
        for time in _TIMES:
            for joint in (" ", "T", ", "):
                keys: dict[str, Any] = {"column": column, "format": f"{date}{joint}{time}"}
                if _fits(file, keys):
                    fitting.append((keys, date))
        for other in others:
            fitting += [
                (keys, date)
                for time in _TIMES
                for keys in ({"column": column, "more": (other,), "format": f"{date} {time}"},)
                if _fits(file, keys)
            ]
    if not fitting:
        return _time_of_day(file, column)
    # Where both orders run alike, a.m. and p.m., and numbers without leading zeros, speak for the month first.
    is_american = any(_AMERICAN.search(text) for text in texts[:200])
    keys, _ = min(fitting, key=lambda each: (_span_ns(file, each[0]), each[1].startswith("%m") != is_american))
    unsure = {}
    if len({other for _, other in fitting}) > 1:
        both = " or ".join(sorted({other for _, other in fitting}))
        unsure["format"] = f"the day or the month first? {both} fit"
    if not any(_says_utc(name) for name in (keys["column"], *keys.get("more", ()))):
        unsure["utc"] = "is it UTC? else utc = false"
    return _spread(TimeGuess({**keys, "utc": True}, unsure), _times(file, keys))


def _time_of_day(file: TableFile, column: str) -> TimeGuess | None:
    """A time without a day."""
    for form in _TIMES:
        keys: dict[str, Any] = {"column": column, "format": form, "wraps_s": 86_400.0}
        if _fits(file, keys):
            return _spread(TimeGuess(keys, {"format": "no day: the log has no date"}), _times(file, keys))
    return None


def _since_1970(file: TableFile, column: str, values: Sequence[float]) -> TimeGuess | None:
    if _is_packed_date(file, column):
        return None
    for least, scale in _EPOCHS:
        if all(least <= value < 14.0 * least for value in values):
            keys: dict[str, Any] = {"column": column, "scale": scale, "unix": True}
            finer = next((name for name in file.table.columns if _NANOSECONDS.search(plain(name))), None)
            if scale == 1.0 and finer is not None and all(0 <= ns < NS_PER_S for ns in _numbers(file, finer)):
                return TimeGuess({**keys, "nanoseconds": finer}, {})
            return _spread(TimeGuess(keys, {}), values)
    return None


def _spread(guess: TimeGuess, values: Sequence[float]) -> TimeGuess:
    """Rows of one stamp lie evenly up to the next."""
    if 2 * sum(a == b for a, b in pairwise(values)) < len(values) - 1 or len(values) < 3:
        return guess
    unsure = {**guess.unsure, "spread": "several rows have the same time"}
    return TimeGuess({**guess.keys, "spread": True}, unsure)


def _counted(file: TableFile, column: str, values: Sequence[float]) -> TimeGuess:
    unsure = {"column": 'counts from an unknown moment; zero_utc = "2026-05-12T10:08:00Z" gives it a date'}
    if file.unit(column, "time") is not None:
        return TimeGuess({"column": column, "scale": file.factor(column, "time")}, unsure)
    # Rows come every 1 ms to 60 s.
    steps = sorted(b - a for a, b in pairwise(values) if b > a)
    step = steps[len(steps) // 2] if steps else 1.0
    known = {"millis": 1e-3, "timems": 1e-3, "time boot ms": 1e-3, "timeus": 1e-6, "time us": 1e-6, "micros": 1e-6}
    scale = known.get(plain(column)) or next((unit for unit in (1.0, 1e-3, 1e-6, 1e-9) if step * unit <= 60.0), 1e-9)
    if plain(column) not in known:
        unsure["scale"] = f"rows are {step * scale:g} s apart then: right?"
    return TimeGuess({"column": column, "scale": scale}, unsure)


def _fits(file: TableFile, keys: dict[str, Any]) -> bool:
    reader = TimeCells(TimeColumn(**keys), file.table.decimal)
    rows = [row for row in file.sample[:200] if not is_nothing(row[keys["column"]])]
    bad = 0
    for row in rows:
        try:
            bad += not 0 <= reader.read(row) < 4_102_444_800 * NS_PER_S
        except Rejected:
            bad += 1
        if bad > (1.0 - _LEAST_SHARE) * len(rows):
            return False
    return bool(rows)


def _times(file: TableFile, keys: dict[str, Any]) -> list[int]:
    """The times of the first rows, ns."""
    reader, times = TimeCells(TimeColumn(**keys), file.table.decimal), []
    for row in file.sample[:200]:
        try:
            times.append(reader.read(row))
        except Rejected:
            continue
    return times


def _span_ns(file: TableFile, keys: dict[str, Any]) -> int:
    """Sum of the steps: the right one of two forms runs through the rows in order."""
    return sum(abs(b - a) for a, b in pairwise(_times(file, keys)))


def _texts(file: TableFile, column: str) -> list[str]:
    return [row[column] for row in file.sample if not is_nothing(row[column])]


def _numbers(file: TableFile, column: str) -> list[float]:
    """The numbers of a column; empty when any cell is none."""
    found = []
    for text in _texts(file, column):
        try:
            found.append(float(with_point(text, file.table.decimal)))
        except ValueError:
            return []
    return found


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[+-]?[0-9]*[.,]?[0-9]+([eE][+-]?[0-9]+)?", text) is not None


def _is_packed_date(file: TableFile, column: str) -> bool:
    """True for a column of days without anything between their parts: 120526, 20260512."""
    texts = _texts(file, column)
    return "dat" in plain(column) and all(text.isdigit() and len(text) in (6, 8) for text in texts)


def _says_utc(column: str) -> bool:
    return any(word in plain(column).split() for word in ("utc", "gmt", "zulu"))
