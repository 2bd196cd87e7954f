r"""Host time stamps of a log: what a program wrote beside each sentence, and when its line came by that.

Read are tag blocks (NMEA 4.10, IEC 61162-450: `\s:mux1,c:1796040000*60\`, seconds or milliseconds since 1970), and a
stamp before or behind a sentence: seconds, milliseconds, microseconds or nanoseconds since 1970, an ISO date and time
(without a zone it is taken for UTC), or a time of day.
"""

import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from itertools import groupby, pairwise
from typing import Final, NamedTuple

from common.units import NS_PER_MS, NS_PER_S
from onboard.devices.nmea_fields import DAY_MS, tod_step_ms
from onboard.devices.nmea_sentence import checksum

EARLIEST_NS: Final = 315_964_800 * NS_PER_S
"""1980-01-06, ns since 1970: what is before it counts from anywhere."""
LATEST_NS: Final = 3_471_292_800 * NS_PER_S
"""2080-01-01, ns since 1970: what is behind it counts from anywhere."""
LEAST_SHARE: Final = 0.5
"""Share of lines with a stamp from which on the stamps are the times of the recording: of a message in several lines
often the first alone has one."""
LATE_NS: Final = NS_PER_S
"""Most that a stamp may lie before the one before, ns: several threads write one log."""
DAMAGED: Final = 20
"""Stamps outside the time between their neighbours are damaged when no more than one in so many is."""
DAMAGED_NS: Final = 10 * NS_PER_S
"""Time by which such a stamp is outside, ns."""
LONGEST_NS: Final = 366 * 86_400 * NS_PER_S
"""A step ahead by more, ns, is a clock that was set."""

_ISO = re.compile(
    r"(\d{4})[-/](\d\d)[-/](\d\d)[T ](\d\d):(\d\d):(\d\d)(?:[.,](\d{1,9}))?\s*(Z|UTC|[+-]\d\d:?\d\d)?(?![\d:])"
)
_TIME = re.compile(r"(?<![\d:.])(\d\d):(\d\d):(\d\d)(?:[.,](\d{1,9}))?(?![\d:])")
_EPOCH = re.compile(r"(?<![\d.:/-])(\d{10,19})(?:\.(\d{1,9}))?(?![\d:/-])")
_BLOCK_TIME = re.compile(r"(?:^|,)c:(\d{1,19})(?=[,*]|$)")
_SEAL = re.compile(r"[0-9A-Fa-f]{2}")
_UNIT_NS: Final = ((11, NS_PER_S), (14, NS_PER_MS), (17, 1_000), (20, 1))
"""From how many digits on a number since 1970 is in a smaller unit."""


class HostStamp(NamedTuple):
    """A time that stands beside a sentence."""

    t_ns: int
    """Time since 1970, since midnight, or since an unknown moment, ns."""
    is_whole: bool
    """True when it has no parts of a second."""


def stamp_in(text: str) -> HostStamp | None:
    """The first stamp in a text that stands before or behind a sentence; `None` = there is none."""
    if match := _ISO.search(text):
        try:
            day = datetime(*(int(match[part]) for part in range(1, 7)), tzinfo=UTC)  # type: ignore[misc, arg-type]
        except ValueError:
            return None
        whole_s = round((day - datetime(1970, 1, 1, tzinfo=UTC)) / timedelta(seconds=1)) - _zone_s(match[8])
        return HostStamp(whole_s * NS_PER_S + _part_ns(match[7]), match[7] is None)
    if match := _EPOCH.search(text):
        return _since_1970(match[1], match[2])
    if match := _TIME.search(text):
        whole_s = (int(match[1]) * 60 + int(match[2])) * 60 + int(match[3])
        return HostStamp(whole_s * NS_PER_S + _part_ns(match[4]), match[4] is None)
    return None


def stamp_of_block(block: str) -> HostStamp | None:
    r"""The stamp in a tag block (without its `\`); `None` = it has no `c:`, or is damaged."""
    said, _, seal = block.rpartition("*")
    if not _SEAL.fullmatch(seal) or int(seal, 16) != checksum(said.encode("latin-1")):
        return None
    match = _BLOCK_TIME.search(block)
    return None if match is None else _since_1970(match[1], None)


def _since_1970(digits: str, part: str | None) -> HostStamp:
    unit_ns = next(unit for most, unit in _UNIT_NS if len(digits) < most)
    return HostStamp(int(digits) * unit_ns + _part_ns(part) * unit_ns // NS_PER_S, unit_ns == NS_PER_S and part is None)


def _part_ns(digits: str | None) -> int:
    return int((digits or "").ljust(9, "0"))


def _zone_s(zone: str | None) -> int:
    if zone is None or zone[0] not in "+-":
        return 0
    hours, minutes = int(zone[1:3]), int(zone[-2:])
    return (-1 if zone[0] == "-" else 1) * (hours * 60 + minutes) * 60


class StampedTimes(NamedTuple):
    """When the lines came by their stamps."""

    at_ns: list[int]
    """Time of each line, in order of time, ns; the first is 0."""
    order: tuple[int, ...] | None
    """Where each line stands in the file; `None` = in that order."""
    first_ns: int
    """HostStamp of the first line, ns."""
    is_whole: bool
    """True when the stamps are whole seconds: lines of one are spread over it."""

    @property
    def utc_ms(self) -> int | None:
        """UTC of the first line by its stamp, ms since 1970; `None` = it has no date."""
        return self.first_ns // NS_PER_MS if EARLIEST_NS <= self.first_ns < LATEST_NS else None

    @property
    def tod_ms(self) -> int | None:
        """Time of day of the first line by its stamp, ms; `None` = it counts from anywhere."""
        is_tod = 0 <= self.first_ns < DAY_MS * NS_PER_MS
        return self.first_ns // NS_PER_MS % DAY_MS if is_tod or self.utc_ms is not None else None


def stamped_times(stamps: Sequence[HostStamp | None]) -> StampedTimes | None:
    """When each line came; `None` = too few have a stamp, or all the same.

    Lines that lie in another order than their stamps are put in that order. A step ahead of more than a year, and a
    step of stamps without a date by which a day begins, are no time that passed.
    """
    known = [stamp for stamp in stamps if stamp is not None]
    if len(known) < 2 or len(known) < LEAST_SHARE * len(stamps) or len({stamp.t_ns for stamp in known}) < 2:
        return None
    times = list(_continued(_filled(stamps)))
    order = None
    if any(b < a - LATE_NS for a, b in pairwise(times)):
        order = tuple(sorted(range(len(times)), key=times.__getitem__))
        times = [times[line] for line in order]
    is_whole = all(stamp.is_whole for stamp in known)
    at_ns = list(_spread_in_second(times)) if is_whole else times
    at_ns = list(_never_back(at_ns))
    return StampedTimes([t_ns - at_ns[0] for t_ns in at_ns], order, times[0], is_whole)


def _filled(stamps: Sequence[HostStamp | None]) -> list[int]:
    """The stamps; a line without one came with the line before it."""
    before_ns = next(stamp.t_ns for stamp in stamps if stamp is not None)
    times = []
    for stamp in stamps:
        before_ns = before_ns if stamp is None else stamp.t_ns
        times.append(before_ns)
    outside = [
        place
        for place, (a, b, c) in enumerate(zip(times, times[1:], times[2:], strict=False), 1)
        if a <= c + LATE_NS and not a - DAMAGED_NS <= b <= c + DAMAGED_NS
    ]
    if DAMAGED * len(outside) <= len(times):
        for place in outside:
            times[place] = times[place - 1]
    return times


def _continued(times: Sequence[int]) -> Iterable[int]:
    """Times over midnight, where they are times of day, and without the year by which a clock was set."""
    day_ns = DAY_MS * NS_PER_MS
    are_tods = all(0 <= t_ns < day_ns for t_ns in times)
    t_ns = before_ns = times[0]
    for said_ns in times:
        if are_tods:
            t_ns += tod_step_ms(before_ns // NS_PER_MS, said_ns // NS_PER_MS) * NS_PER_MS
        elif abs(said_ns - before_ns) <= LONGEST_NS:
            t_ns += said_ns - before_ns
        before_ns = said_ns
        yield t_ns


def _spread_in_second(times: Sequence[int]) -> Iterable[int]:
    for t_ns, group in groupby(times):
        count = sum(1 for _ in group)
        yield from (t_ns + place * NS_PER_S // count for place in range(count))


def _never_back(times: Iterable[int]) -> Iterable[int]:
    newest_ns: int | None = None
    for t_ns in times:
        newest_ns = t_ns if newest_ns is None else max(newest_ns, t_ns)
        yield newest_ns
