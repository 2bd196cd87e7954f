"""Time columns of a table: the form of texts and the unit of numbers, by trying them (format inference)."""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

from common.errors import WayfixError
from common.simulation.column_map import TimeColumn
from common.units import NS_PER_S
from shore.imports.cells import is_nothing, with_point
from shore.imports.guess_names import candidates, is_other, plain, utc_word
from shore.imports.line_counts import Rejected
from shore.imports.table_file import TableFile
from shore.imports.time_cells import GPS_EPOCH_S, WEEK_S, TimeCells, looks_like

_DATES: Final = (
    "%Y-%m-%d", "%Y/%m/%d", "%Y.%m.%d", "%d.%m.%Y", "%d.%m.%y", "%d/%m/%Y", "%m/%d/%Y", "%d/%m/%y", "%m/%d/%y",
    "%d-%m-%Y", "%m-%d-%Y", "%d-%b-%Y", "%d-%b-%y", "%d %b %Y", "%b %d %Y", "%Y%m%d", "%d%m%y", "%y%m%d",
)  # fmt: skip
_TIMES: Final = (
    "%H:%M:%S", "%H:%M:%S:%f", "%I:%M:%S %p", "%H:%M", "%I:%M %p", "%H%M%S", "%H%M%S%f", "%H.%M.%S",
)  # fmt: skip
_WHOLE: Final = ("%a %b %d %H:%M:%S %Y",)
"""Forms in which the time of day stands within the date."""
_LEAST_SHARE: Final = 0.9
"""Share of the rows that a form must fit."""
_EPOCHS: Final = ((1e18, 1e-9), (1e15, 1e-6), (1e12, 1e-3), (1e9, 1.0))
"""Powers of ten of today's numbers since 1970 in each unit, and the seconds in it."""
_YEAR_2000_S: Final = 946_684_800
_DAY_S: Final = 86_400
_FIT_EPOCH: Final = "1989-12-31T00:00:00Z"
"""Where the time of Garmin's FIT files begins."""
_NANOSECONDS: Final = re.compile(r"\b(nsecs?|nanosecs?|nanoseconds)$")
_CLOCK: Final = re.compile(r"[0-2][0-9][0-5][0-9][0-5][0-9](\.[0-9]*)?")
"""A time of day without anything between its parts: 100800.00."""
_JOINED: Final = re.compile(r"(19|20)[0-9]{12}([0-9]{3})?")
"""Date and time without anything between their parts."""
_SHORT: Final = re.compile(r"[0-9]{1,2}:[0-5][0-9](\.[0-9]+)?")
_COUNTERS: Final = {
    "millis": 1e-3, "timems": 1e-3, "time ms": 1e-3, "time boot ms": 1e-3, "timeus": 1e-6, "time us": 1e-6,
    "micros": 1e-6, "elapsed": 1.0,
}  # fmt: skip
_DAYS: Final = {25_569.0: (20_000.0, 80_000.0), 719_529.0: (700_000.0, 790_000.0), 2_440_587.5: (2.43e6, 2.5e6)}
"""The number of 1970-01-01 in Excel, in MATLAB and of Julian days, and the numbers of the years around it."""
_EXCEL: Final = 25_569.0
_MOST_BEHIND_S: Final = 12 * 3600
"""Local time is at most so much behind UTC, s."""
_PARTS: Final = ("year", "month", "day", "hour", "minute", "second")


class TimeGuess(NamedTuple):
    """The table `[time]` of a proposal."""

    keys: dict[str, Any]
    unsure: dict[str, str]
    """A comment for a person on each key that is not sure."""
    question: tuple[str, tuple[str, ...]] = ("", ())
    """What only a person knows, and the lines of which one must be taken; none = nothing."""

    @property
    def columns(self) -> set[str]:
        """The columns that it takes."""
        keys = self.keys
        return {keys["column"], *keys.get("more", ()), *(keys[key] for key in ("week", "nanoseconds") if key in keys)}


def time_of(path: Path, file: TableFile, now_s: float, *, by_name: bool = True) -> TimeGuess | None:
    """What the time of a table is; `None` = no column looks like one.

    now_s: UTC, s since 1970: nothing was recorded later. by_name: False = names say nothing. Raises WayfixError for
    numbers of which no clock is known.
    """
    clocks = _Clocks(path, file, now_s)
    guess = _by_name(file, clocks) if by_name else clocks.of(file.table.columns, file.table.columns)
    guess = guess or clocks.counted(candidates(file.table.columns, "time") if by_name else file.table.columns)
    if guess is not None and not guess.question[1]:
        clocks.check(guess)
    return guess


def _by_name(file: TableFile, clocks: "_Clocks") -> TimeGuess | None:
    named = candidates(file.table.columns, "time")
    if (guess := clocks.week() or clocks.parts()) is not None:
        return guess
    time_of_day = None
    unnamed = [column for column in file.table.columns if not column]
    for word in (1, 0, -2, -1):
        group = [column for column in named if utc_word(column) == word]
        others = [column for column in named if utc_word(column) in {word, 0}]
        guess = clocks.of(group, [*others, *unnamed])
        if guess is not None and "wraps_s" not in guess.keys:
            return clocks.with_day(_of_clock(guess, word), named)
        time_of_day = time_of_day or guess
    return time_of_day or clocks.of(unnamed, unnamed)


def _of_clock(guess: TimeGuess, word: int) -> TimeGuess:
    """What the name of a column says of its clock, in the mapping."""
    if not guess.keys.get("utc") or word >= 0:
        unsure = {key: words for key, words in guess.unsure.items() if key != "utc" or word == 0}
        return guess._replace(unsure=unsure)
    keys = {key: value for key, value in guess.keys.items() if key != "utc"}
    if word == -2:
        return guess._replace(keys={**keys, "gps": True}, unsure={"gps": "GPS time has no leap seconds"})
    return guess._replace(keys=keys, unsure={**guess.unsure, "column": "local time, so the log has no UTC"})


class _Clocks:
    """What the columns of one table can be."""

    def __init__(self, path: Path, file: TableFile, now_s: float) -> None:
        self._path, self._file, self._now_s = path, file, now_s

    def of(self, columns: Sequence[str], others: Sequence[str]) -> TimeGuess | None:
        """The columns of one clock, and those that may hold its day or its time of day."""
        if not columns:
            return None
        numbers = [(column, values) for column in columns if (values := self._numbers(column))]
        for column, values in numbers:
            if (guess := self._since_epoch(column, values)) is not None:
                return guess
        time_of_day = None
        for column in columns:
            guess = self._text(column, others)
            if guess is not None and "wraps_s" not in guess.keys:
                return guess
            time_of_day = time_of_day or guess
        return self._days(numbers) or time_of_day

    def check(self, guess: TimeGuess) -> None:
        """Raises WayfixError for a time that stands still: a spreadsheet has rounded it."""
        times = self._times(guess.keys)
        if len(times) > 2 and len(set(times)) == 1:
            columns = " + ".join((guess.keys["column"], *guess.keys.get("more", ())))
            what = f"column {columns!r} is {self._texts(guess.keys['column'])[0]!r} in all of the first rows"
            raise WayfixError(what, str(self._path), "export the table again, with all digits of the time")

    def with_day(self, guess: TimeGuess, named: Sequence[str]) -> TimeGuess:
        """The same with a doubt, where the time of day is UTC, and the day may be that of a local clock beside it.

        Raises WayfixError where the local clock shows that the day of UTC is another one.
        """
        more = guess.keys.get("more", ())
        if len(more) != 1 or utc_word(guess.keys["column"]) == 1 or utc_word(more[0]) != 1:
            return guess
        day, utc = guess.keys["column"], more[0]
        local = next((each for name in named if name not in (day, utc) and (each := self._time_of_day(name))), None)
        clock = self._time_of_day(utc)
        if local is None or clock is None:
            return guess._replace(unsure={**guess.unsure, "column": "is this the day of UTC?"})
        local_s, utc_s = (self._times(each.keys)[0] / NS_PER_S % _DAY_S for each in (local, clock))
        ahead_s = (local_s - utc_s + _MOST_BEHIND_S) % _DAY_S - _MOST_BEHIND_S
        if 0.0 <= utc_s + ahead_s < _DAY_S:
            return guess
        what = f"column {day!r} is the local day, and that of {utc!r} is another one, which no column says"
        cure = f"map {day} and {local.keys['column']} without utc by hand (docs/mapping.md): the log has no UTC then"
        raise WayfixError(what, str(self._path), cure)

    def week(self) -> TimeGuess | None:
        """GPS week and time of week."""
        names = self._file.table.columns
        unnamed = [name for name in names if not name]
        gps = [name for name in candidates(names, "time") if utc_word(name) == -2]
        for week in (*candidates(names, "week"), *unnamed):
            for tow in candidates(names, "tow") if week else gps:
                weeks, tows = self._numbers(week), self._numbers(tow)
                if week == tow or not weeks or not tows or not all(1000 <= each < 5000 for each in weeks):
                    continue
                scale = 1.0 if max(tows) <= WEEK_S else 1e-3
                return TimeGuess({"column": tow, "week": week, "gps": True, "scale": scale}, {})
        return None

    def parts(self) -> TimeGuess | None:
        """A column for each of year, month, day, hour, minute and second."""
        found = [next(iter(candidates(self._file.table.columns, part)), None) for part in _PARTS]
        if None in found or len(set(found)) < len(_PARTS):
            return None
        year, *more = found
        keys = {"column": year, "more": tuple(more), "format": "%Y %m %d %H %M %S", "utc": True}
        return TimeGuess(keys, {"utc": "is it UTC? else utc = false"}) if self._fits(keys) else None

    def counted(self, columns: Sequence[str]) -> TimeGuess | None:
        """Numbers that grow, from a moment that nobody knows."""
        for column in columns:
            values = self._numbers(column)
            grow = sum(b >= a for a, b in pairwise(values)) > _LEAST_SHARE * (len(values) - 1)
            is_counter = plain(column) in _COUNTERS and len(set(values)) > _LEAST_SHARE * len(values)
            if len(values) > 1 and (grow or is_counter):
                return self._counter(column, values)
        return None

    def _since_epoch(self, column: str, values: Sequence[float]) -> TimeGuess | None:
        if self._is_packed_date(column) or all(map(_JOINED.fullmatch, self._texts(column))):
            return None
        for unit, scale in _EPOCHS:
            steps = sorted(abs(b - a) for a, b in pairwise(values))
            is_counter = bool(steps) and steps[len(steps) // 2] * scale > _DAY_S
            if is_counter or not all(0.4 * unit <= value < 4.2 * unit for value in values):
                continue
            if len(set(values)) < len(values) / 2 and all("e" in text.casefold() for text in self._texts(column)):
                what = f"column {column!r} is rounded ({self._texts(column)[0]}): a spreadsheet wrote it so"
                raise WayfixError(what, str(self._path), "export the table again, with all digits of this column")
            return self._epoch(column, values, scale)
        return None

    def _epoch(self, column: str, values: Sequence[float], scale: float) -> TimeGuess:
        seconds, words = (min(values) * scale, max(values) * scale), set(plain(column).split())
        keys: dict[str, Any] = {"column": column, "scale": scale}
        if "gps" in words and words & {"s", "sec", "secs", "seconds"}:
            return TimeGuess({**keys, "gps": True}, {})
        if {plain(name) for name in self._file.table.columns} >= {"position lat", "position long"}:
            return TimeGuess({**keys, "zero_utc": _FIT_EPOCH}, {"zero_utc": "the time of FIT files"})
        if not (seconds[0] >= _YEAR_2000_S and seconds[1] < self._now_s + _DAY_S):
            what = f"column {column!r} counts from a moment that is not known ({self._texts(column)[0]})"
            raise WayfixError(
                what, str(self._path), "write [time] column, scale and zero_utc by hand (docs/mapping.md)"
            )
        if "gps" in words and seconds[1] + GPS_EPOCH_S < self._now_s + _DAY_S:
            both = "does it count from 1970, or from 1980-01-06 without leap seconds (GPS)?"
            return TimeGuess(keys, {}, (both, ("unix = true", "gps = true")))
        keys["unix"] = True
        finer = next((name for name in self._file.table.columns if _NANOSECONDS.search(plain(name))), None)
        if scale == 1.0 and finer is not None and all(0 <= ns < NS_PER_S for ns in self._numbers(finer)):
            return TimeGuess({**keys, "nanoseconds": finer}, {})
        return _spread(TimeGuess(keys, {}), values)

    def _text(self, column: str, named: Sequence[str]) -> TimeGuess | None:
        texts = self._texts(column)
        if not texts or is_other(column):
            return None
        if all(map(_JOINED.fullmatch, texts)):
            form = "%Y%m%d%H%M%S" + ("%f" if len(texts[0]) > 14 else "")
            return TimeGuess({"column": column, "format": form, "utc": True}, {"utc": "is it UTC? else utc = false"})
        if all(map(_is_number, texts)) and not self._is_packed_date(column):
            if not all(map(_CLOCK.fullmatch, texts)):
                return None
            fitting = self._forms(column, [name for name in named if name != column and self._is_packed_date(name)])
            return self._chosen(column, fitting) if fitting else self._time_of_day(column)
        if self._fits({"column": column, "format": "iso"}):
            has_zone = texts[0].rstrip()[-1:] in ("Z", "C") or "+" in texts[0]
            unsure = {} if has_zone else {"utc": "is it UTC? else utc = false"}
            guess = TimeGuess({"column": column, "format": "iso", "utc": True}, unsure)
            return _spread(guess, self._times(guess.keys))
        fitting = self._forms(column, [name for name in named if name != column and self._texts(name)])
        return self._chosen(column, fitting) if fitting else self._time_of_day(column)

    def _forms(self, column: str, others: Sequence[str]) -> list[tuple[dict[str, Any], str]]:
        """Every form that fits, with that of its date."""
        forms: list[tuple[dict[str, Any], str]]
        forms = [({"column": column, "format": form}, form) for form in _WHOLE]
        forms += [
            ({"column": column, "format": f"{date}{joint}{time}"}, date)
            for date in _DATES
            for time in _TIMES
            for joint in (" ", "T", ", ")
        ]
        forms += [
            ({"column": day, "more": (clock,), "format": f"{date} {time}"}, date)
            for date in _DATES
            for other in others
            for day, clock in ((column, other), (other, column))
            for time in _TIMES
        ]
        return [(keys, date) for keys, date in forms if self._has_digits(keys) and self._fits(keys)]

    def _has_digits(self, keys: dict[str, Any]) -> bool:
        """False where a clock of six digits would lose the last one to a fraction."""
        clock = keys.get("more", (keys["column"],))[-1]
        return not keys["format"].endswith("%S%f") or all(len(text) > 6 for text in self._texts(clock))

    def _chosen(self, column: str, fitting: Sequence[tuple[dict[str, Any], str]]) -> TimeGuess:
        """The form that runs through the rows in order; of dates without separators the one that the name says."""
        spans = [self._span_ns(keys) for keys, _ in fitting]
        least = [each for each, span in zip(fitting, spans, strict=True) if span == min(spans)]
        years_first = plain(column).replace(" ", "").startswith("yy") or "%Y" in least[0][1]
        keys, _ = next((each for each in least if each[1] != "%d%m%y" or not years_first), least[0])
        unsure = {"utc": "is it UTC? else utc = false"}
        orders = dict.fromkeys(date for _, date in least if "%b" not in date and date[2:3] in "/-.")
        if len(orders) > 1 and not keys["format"].startswith("%Y"):
            rest = keys["format"].removeprefix(next(date for date in orders if keys["format"].startswith(date)))
            lines = tuple(f'format = "{date}{rest}"' for date in orders)
            question = "the day or the month first?", lines
            return TimeGuess({**{key: value for key, value in keys.items() if key != "format"}, "utc": True}, unsure,
                             question)  # fmt: skip
        if len({date for _, date in least}) > 1:
            both = " or ".join(sorted({date for _, date in least}))
            unsure["format"] = f"the day or the year first? {both} fit"
        return _spread(TimeGuess({**keys, "utc": True}, unsure), self._times(keys))

    def _time_of_day(self, column: str) -> TimeGuess | None:
        """A time without a day."""
        if "elapsed" in plain(column).split() and all(map(_SHORT.fullmatch, self._texts(column))):
            return TimeGuess(
                {"column": column, "format": "%M:%S", "wraps_s": 3600.0}, {"format": "minutes and seconds?"}
            )
        for form in _TIMES:
            keys: dict[str, Any] = {"column": column, "format": form, "wraps_s": float(_DAY_S)}
            if self._fits(keys):
                return _spread(TimeGuess(keys, {"format": "no day: the log has no date"}), self._times(keys))
        return None

    def _days(self, numbers: Sequence[tuple[str, Sequence[float]]]) -> TimeGuess | None:
        """Days of a spreadsheet, with the time of day behind the point or in another column."""
        unsure = {"utc": "is it UTC? A spreadsheet keeps local time as it was shown"}
        for column, values in numbers:
            for zero, (low, high) in _DAYS.items():
                if not all(low < value < high for value in values):
                    continue
                keys: dict[str, Any] = {"column": column, "utc": True}
                keys |= {"excel": True} if zero == _EXCEL else {"day_of_1970": zero}
                if any(value % 1.0 for value in values):
                    return TimeGuess(keys, unsure)
                part = next((name for name, parts in numbers if all(0 <= each < 1 for each in parts)), None)
                if part is not None and zero == _EXCEL:
                    return TimeGuess({**keys, "more": (part,)}, unsure)
        return None

    def _counter(self, column: str, values: Sequence[float]) -> TimeGuess:
        unsure = {"column": 'counts from an unknown moment; zero_utc = "2026-05-12T10:08:00Z" gives it a date'}
        if self._file.unit(column, "time") is not None:
            return TimeGuess({"column": column, "scale": self._file.factor(column, "time")}, unsure)
        # Rows come every 1 ms to 60 s.
        steps = sorted(b - a for a, b in pairwise(sorted(values)) if b > a)
        step = steps[len(steps) // 2] if steps else 1.0
        units = (1.0, 1e-3, 1e-6, 1e-9)
        scale = _COUNTERS.get(plain(column)) or next((unit for unit in units if step * unit <= 60.0), 1e-9)
        if plain(column) not in _COUNTERS:
            unsure["scale"] = f"rows are {step * scale:g} s apart then: right?"
        return TimeGuess({"column": column, "scale": scale}, unsure)

    def _fits(self, keys: dict[str, Any]) -> bool:
        rows = [row for row in self._file.sample[:200] if not is_nothing(row[keys["column"]])]
        columns = (keys["column"], *keys.get("more", ()))
        if not any(looks_like(" ".join(row[name] for name in columns), keys["format"]) for row in rows[:3]):
            return False
        reader, bad = TimeCells(TimeColumn(**keys), self._file.table.decimal), 0
        for row in rows:
            try:
                bad += not 0 <= reader.read(row) < (self._now_s + _DAY_S) * NS_PER_S
            except Rejected:
                bad += 1
            if bad > (1.0 - _LEAST_SHARE) * len(rows):
                return False
        return bool(rows)

    def _times(self, keys: dict[str, Any]) -> list[int]:
        """The times of the first rows, ns."""
        reader, times = TimeCells(TimeColumn(**keys), self._file.table.decimal), []
        for row in self._file.sample[:200]:
            try:
                times.append(reader.read(row))
            except Rejected:
                continue
        return times

    def _span_ns(self, keys: dict[str, Any]) -> int:
        """Sum of the steps: the right one of two forms runs through the rows in order."""
        return sum(abs(b - a) for a, b in pairwise(self._times(keys)))

    def _texts(self, column: str) -> list[str]:
        return [row[column] for row in self._file.sample if not is_nothing(row[column])]

    def _numbers(self, column: str) -> list[float]:
        """The numbers of a column; empty when any cell is none."""
        found = []
        for text in self._texts(column):
            try:
                found.append(float(with_point(text, self._file.table.decimal)))
            except ValueError:
                return []
        return found

    def _is_packed_date(self, column: str) -> bool:
        """True for a column of days without anything between their parts: 120526, 20260512, 50126."""
        texts, name = self._texts(column), plain(column)
        is_date = any(word in name for word in ("dat", "ddmmyy", "yymmdd", "mmddyy", "yyyymmdd", "fecha"))
        return is_date and all(text.isdigit() and len(text) in (5, 6, 8) for text in texts)


def _spread(guess: TimeGuess, values: Sequence[float]) -> TimeGuess:
    """Rows of one stamp lie evenly up to the next."""
    if 2 * sum(a == b for a, b in pairwise(values)) < len(values) - 1 or len(values) < 3:
        return guess
    unsure = {**guess.unsure, "spread": "several rows have the same time"}
    return guess._replace(keys={**guess.keys, "spread": True}, unsure=unsure)


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[+-]?[0-9]*[.,]?[0-9]+([eE][+-]?[0-9]+)?", text) is not None
