"""Time of a row (timestamp parsing): text in a given form, numbers since an epoch, days, GPS weeks."""

import re
from bisect import bisect_right
from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation
from functools import cache
from typing import Final

from common.simulation.column_map import TimeColumn
from common.units import NS_PER_MS, NS_PER_S, NS_PER_US
from shore.imports.cell_columns import BadCell, Cells
from shore.imports.cells import is_nothing, with_point
from shore.imports.line_counts import Rejected
from shore.imports.values import utc_ns_of

ISO: Final = "iso"
EXCEL_OF_1970: Final = 25_569.0
"""Excel's number of the day 1970-01-01."""
GPS_EPOCH_S: Final = 315_964_800
"""1980-01-06, s since 1970: where GPS time begins."""
WEEK_S: Final = 604_800
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_MIDNIGHT: Final = datetime(1900, 1, 1, tzinfo=UTC)
"""The day that strptime gives to a time of day."""
_FINER: Final = re.compile(r"(?<=[0-9][.,][0-9]{6})[0-9]+")
"""Decimals of a second beyond microseconds, which strptime refuses."""
_LEAPS: Final = tuple(
    round(datetime.fromisoformat(f"{day}T00:00:00+00:00").timestamp())
    for day in (
        "1981-07-01", "1982-07-01", "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01", "1991-01-01", "1992-07-01",
        "1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01", "1999-01-01", "2006-01-01", "2009-01-01", "2012-07-01",
        "2015-07-01", "2017-01-01",
    )
)  # fmt: skip
"""UTC before which a leap second was put in, since GPS time began, s since 1970 (IERS Bulletin C)."""
_MONTHS: Final = {
    "Jan": r"jan|ene|gen",
    "Feb": r"feb|fe[bv]|f[ée]v",
    "Mar": r"mar|m[äa]r|maer|mrz|mär",
    "Apr": r"apr|abr|avr",
    "May": r"mai|may|mag",
    "Jun": r"juni?\b|juin|giu|june",
    "Jul": r"jul|juil|lug",
    "Aug": r"aug|ago|ao[uû]",
    "Sep": r"sep|set",
    "Oct": r"oct|okt|ott",
    "Nov": r"nov",
    "Dec": r"dec|dez|dic|d[ée]c",
}
"""How the names of a month begin in English, German, French, Spanish and Italian."""
_MONTH: Final = re.compile(r"[^\W\d_]{3,}\.?")
_DAY_POINT: Final = re.compile(r"(?<=[0-9])\.(?=\s*[^\W\d_])")
"""The point of an ordinal before the month's name: 12. Mai."""
_PACKED: Final = re.compile(r"(?:%[YmdyHMSf])+")
_WIDTHS: Final = {"Y": 4, "f": 2}
_DIRECTIVES: Final = {
    "%Y": "[0-9]{4}", "%f": "[0-9]+", "%S": "[0-9]{1,2}([.,][0-9]+)?", "%b": r"[^\W\d_]{3,}", "%a": r"[^\W\d_]{3,}",
    "%p": "[AaPp][Mm]", **dict.fromkeys(("%m", "%d", "%y", "%H", "%I", "%M"), "[0-9]{1,2}"),
}  # fmt: skip


class TimeCells:
    """The time of a row."""

    def __init__(self, time: TimeColumn, decimal: str, named: float = 1.0) -> None:
        """named: seconds in one unit of the column by its name."""
        self._time = time
        self._decimal = decimal
        self._zero_ns = utc_ns_of(time.zero_utc) or 0
        self._scale = Decimal(repr(named if time.scale is None else time.scale))
        self._day_of_1970 = EXCEL_OF_1970 if time.excel else time.day_of_1970
        self._formats = () if time.format is None else _formats(time.format)
        self._widths = () if time.format is None else tuple(map(_width, time.format.split(" ")))
        self._epoch = _EPOCH if has_date(time.format) else _MIDNIGHT

    def read(self, cells: Cells) -> int:
        """Time of a row, ns; raises BadCell."""
        time = self._time
        text = " ".join(text for text in (cells[name] for name in (time.column, *time.more)) if text)
        try:
            t_ns = self._ns(cells, text)
        except Rejected as reason:
            raise BadCell(str(reason).removeprefix("time: "), " + ".join((time.column, *time.more)), text) from None
        return utc_of_gps(t_ns) if time.gps else t_ns

    def _ns(self, cells: Cells, text: str) -> int:
        time = self._time
        if is_nothing(text):
            raise Rejected("empty")
        if time.format == ISO:
            return utc_ns_of(text) or 0
        if time.format is not None:
            return self._written_ns(text)
        if self._day_of_1970 is not None:
            days = sum(_decimal(with_point(part, self._decimal)) for part in text.split()) - Decimal(self._day_of_1970)
            if not -Decimal(EXCEL_OF_1970) < days < 2_932_897:
                raise Rejected("no day that is counted so")
            return round(days * 86_400_000) * NS_PER_MS
        seconds = _decimal(with_point(cells[time.column], self._decimal)) * self._scale
        if time.nanoseconds is not None:
            seconds += _decimal(cells[time.nanoseconds]) / NS_PER_S
        if time.week is not None:
            seconds += _decimal(cells[time.week]) * WEEK_S
        if time.gps:
            seconds += GPS_EPOCH_S
        if not -4_000_000_000 <= seconds <= 4_000_000_000:
            raise Rejected("out of range")
        return self._zero_ns + int(seconds * 1_000_000) * NS_PER_US

    def _written_ns(self, text: str) -> int:
        if any(self._widths):
            text = self._with_zeros(text)
        if "%b" in self._formats[0]:
            text = with_english_month(text)
        for form in self._formats:
            try:
                moment = datetime.strptime(_FINER.sub("", text), form)  # noqa: DTZ007 (made UTC below)
            except ValueError:
                continue
            since = (moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment) - self._epoch
            return since // timedelta(microseconds=1) * NS_PER_US
        raise Rejected("not in the form of the mapping")

    def _with_zeros(self, text: str) -> str:
        """The text with the leading zeros that a spreadsheet ate: 50126 is the 5th of January 2026."""
        parts = text.split(" ")
        if len(parts) != len(self._widths):
            return text
        return " ".join(
            part.partition(".")[0].zfill(width) + "".join(part.partition(".")[1:])
            if width and part.partition(".")[0].isdigit()
            else part
            for part, width in zip(parts, self._widths, strict=True)
        )


def utc_of_gps(t_ns: int) -> int:
    """A moment that is written in GPS time -> UTC, both ns since 1970."""
    leaps = bisect_right(_LEAPS, t_ns // NS_PER_S)
    leaps = bisect_right(_LEAPS, t_ns // NS_PER_S - leaps)
    return t_ns - leaps * NS_PER_S


def with_english_month(text: str) -> str:
    """A date whose month has its English abbreviation, as strptime reads it; weekdays are left as they are."""
    return _MONTH.sub(_english, _DAY_POINT.sub(" ", text)).replace("  ", " ")


def has_date(form: str | None) -> bool:
    """True when a form of a time holds the day; without it a time counts from midnight."""
    return form is None or form == ISO or any(part in form for part in ("%d", "%j", "%x", "%c"))


def _english(match: re.Match[str]) -> str:
    word = match[0].casefold()
    name = next((name for name, begins in _MONTHS.items() if re.match(begins, word)), match[0])
    return f"{name} " if word.endswith(".") else name


def _formats(given: str) -> tuple[str, ...]:
    """The form, and the same with or without decimals of the second: writers leave them out of a whole second."""
    if "%f" in given:
        return (given, given.replace(".%f", "").replace(",%f", ""))
    return (given, given.replace("%S", "%S.%f"), given.replace("%S", "%S,%f")) if "%S" in given else (given,)


def _width(form: str) -> int:
    """Digits of a part of a form in which nothing stands between the fields; 0 = something does."""
    return sum(_WIDTHS.get(letter, 2) for letter in form[1::2]) if _PACKED.fullmatch(form) and len(form) > 2 else 0


def looks_like(text: str, form: str) -> bool:
    """Whether a text may be in a form; quick, since strptime keeps only a few forms ready."""
    if form == ISO:
        return True
    return _shape(form).fullmatch(with_english_month(text) if "%b" in form else text) is not None


@cache
def _shape(form: str) -> re.Pattern[str]:
    """Digits and letters of a form."""
    parts = []
    for part in form.split(" "):
        if width := _width(part):
            parts.append(rf"[0-9]{{1,{width + 8 * ('%f' in part)}}}([.,][0-9]+)?")
        else:
            parts.append("".join(_DIRECTIVES.get(each, re.escape(each)) for each in re.findall("%.|[^%]", part)))
    return re.compile(r"\s+".join(parts))


def _decimal(text: str) -> Decimal:
    if is_nothing(text):
        raise Rejected("empty")
    try:
        value = Decimal(text)
    except InvalidOperation:
        raise Rejected("not a number") from None
    if not value.is_finite():
        raise Rejected("not a number")
    return value
