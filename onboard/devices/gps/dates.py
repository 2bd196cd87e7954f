"""Dates of satellite receivers: how they are read (two-digit years are 1980 to 2079), and which can be (week rollover).

A GPS week number begins again every 1024 weeks (19.6 years); a receiver whose firmware does not know the present turn
gives a date that much in the past, twice that much if the firmware is from before 1999, with the right time of day.
Such a date is repaired, +1024 or +2048 weeks, only where the result is proved: by a mapping that it meets to the second
(another receiver, or itself before its turn), or by the board's file, whose owner knows the receiver. A daemon alone
cannot tell it from an old recording that is played, so else it is offered in words and not used. What is repaired says
so in `source`, and `utc_src` stays `gnss`: all but the turn is the receiver's own.

An archive (`convert`, `wayfix import`) may be of any year since GPS was complete: its dates are believed as they are,
unless they contradict the recording's own by a turn.
"""

import re
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from typing import Final

from common.events import event
from common.framer import Utc
from common.messages import ClockPair, Event
from common.units import NS_PER_S
from onboard.devices.nmea_fields import FieldFault

EARLIEST_UTC_NS: Final = 1_704_067_200 * NS_PER_S
"""2024-01-01, ns since 1970, before this program was first released: no boat that runs it can be earlier."""
EARLIEST_ARCHIVE_NS: Final = 788_918_400 * NS_PER_S
"""1995-01-01, ns since 1970: GPS was declared complete in 1995, and logs of before are rarer than lost weeks."""
LATEST_UTC_NS: Final = 3_471_292_800 * NS_PER_S
"""2080-01-01, ns since 1970: `80` is GPS's year 1980, which a receiver without a date gives."""
ROLLOVER_NS: Final = 1024 * 7 * 86_400 * NS_PER_S
MET_NS: Final = 2 * NS_PER_S
"""A repaired date that comes so near to the known UTC is proved."""
TOLD_AFTER: Final = 10
"""Number of pairs in a row after which a doubted receiver is reported, once; one just woken may give a few odd
dates."""

_DATE = re.compile(r"([0-9]{2})([0-9]{2})([0-9]{2})")
_DIGITS = re.compile(r"[0-9]+")
_FIRST_DAY: Final = datetime(1970, 1, 1, tzinfo=UTC)


def short_date(text: str) -> date | None:
    """`ddmmyy`; see `_year`. All zeros is what receivers write that know no date."""
    if not text or text == "000000":
        return None
    match = _DATE.fullmatch(text)
    if match is None:
        raise FieldFault("date")
    return _date(_year(match[3]), int(match[2]), int(match[1]))


def long_date(day: str, month: str, year: str) -> date | None:
    """Day, month and year (1980-2099), all of them or none (also as 00,00); a year of two digits: `_year`."""
    if not (day or month or year) or (day, month) == ("00", "00"):
        return None
    if not all(_DIGITS.fullmatch(text) for text in (day, month, year)) or len(day) > 2 or len(month) > 2:
        raise FieldFault("date")
    if len(year) == 2:
        return _date(_year(year), int(month), int(day))
    if len(year) != 4 or not 1980 <= int(year) <= 2099:
        raise FieldFault("date")
    return _date(int(year), int(month), int(day))


def _year(two_digits: str) -> int:
    """1980-2079: before 1980 there was no GPS, and `80` is what a receiver that knows no date writes."""
    return (1900 if two_digits >= "80" else 2000) + int(two_digits)


def _date(year: int, month: int, day: int) -> date:
    try:
        return date(year, month, day)
    except ValueError:
        raise FieldFault("date") from None


class Dates:
    """Judges every pair before it goes into a frame or into the mapping."""

    def __init__(
        self, tell: Callable[[Event], None], rolled_over: Collection[str] = (), *, is_archive: bool = False
    ) -> None:
        """tell: takes the event of an odd date, once for each sensor; rolled_over: sensors to be repaired.

        is_archive: a recording is read, of whatever year.
        """
        self._tell = tell
        self._is_archive = is_archive
        self._rolled_over = frozenset(rolled_over)
        self._odd: Counter[tuple[str, str]] = Counter()
        """Number of odd pairs in a row, by sensor and event code."""
        self._told: set[tuple[str, str]] = set()

    def judge(self, pair: ClockPair, known: Utc) -> ClockPair | None:
        """The pair as it may be used, repaired perhaps, or None; known: UTC of the same boat time as mapped so far."""
        met = _met(pair, known) if self._is_archive else None
        if EARLIEST_UTC_NS <= pair.utc_ns < LATEST_UTC_NS or (met is None and self._is_of_archive(pair)):
            self._note(pair, None)
            return pair
        later = met or _repaired(pair)
        if later is None:
            self._note(pair, "date-refused", date=_text(pair))
            return None
        is_met = known.utc_ns is not None and abs(later.utc_ns - known.utc_ns) <= MET_NS
        if is_met or pair.sensor in self._rolled_over:
            self._note(pair, "week-rollover-repaired", date=_text(pair), later=_text(later))
            return later
        self._note(pair, "week-rollover", date=_text(pair), later=_text(later))
        return None

    def _is_of_archive(self, pair: ClockPair) -> bool:
        """A past date that may be right: the owner of the receiver names no lost weeks."""
        is_past = EARLIEST_ARCHIVE_NS <= pair.utc_ns < EARLIEST_UTC_NS
        return self._is_archive and is_past and pair.sensor not in self._rolled_over

    def _note(self, pair: ClockPair, code: str | None, **evidence: str) -> None:
        for key in [key for key in self._odd if key[0] == pair.sensor and key[1] != code]:
            del self._odd[key]
        if code is None:
            return
        key = pair.sensor, code
        self._odd[key] += 1
        if self._odd[key] >= TOLD_AFTER and key not in self._told:
            self._told.add(key)
            self._tell(event(code, pair.t_ns, pair.sensor, sensor=pair.sensor, **evidence))


def _repaired(pair: ClockPair) -> ClockPair | None:
    """The pair after one turn of the weeks, else after two; `None` = neither date can be."""
    turned = (_turned(pair, turns) for turns in (1, 2))
    return next((later for later in turned if EARLIEST_UTC_NS <= later.utc_ns < LATEST_UTC_NS), None)


def _met(pair: ClockPair, known: Utc) -> ClockPair | None:
    """The pair after one turn or two where that meets the known UTC."""
    turned = (_turned(pair, turns) for turns in (1, 2))
    return next(
        (later for later in turned if known.utc_ns is not None and abs(later.utc_ns - known.utc_ns) <= MET_NS), None
    )


def _turned(pair: ClockPair, turns: int) -> ClockPair:
    return replace(pair, utc_ns=pair.utc_ns + turns * ROLLOVER_NS, source=f"{pair.source}+{1024 * turns}w")


def _text(pair: ClockPair) -> str:
    return (_FIRST_DAY + timedelta(seconds=pair.utc_ns // NS_PER_S)).date().isoformat()
