"""Diagnostics of a recording's time base: its clocks, order, jumps and gaps, a sentence each."""

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Final

from common.boat_config import BoatConfig
from common.units import NS_PER_MS, NS_PER_S
from onboard.devices.gps.dates import EARLIEST_ARCHIVE_NS
from onboard.recorded.recording import Paced

TOLD_STAMP_S: Final = 5.0
"""Smallest offset of time stamps from the sentences that is said, s."""


def time_notes(paced: Paced) -> Iterator[str]:
    """What a person should know of the recording's times."""
    schedule, numbers = paced.schedule, paced.recording.numbers
    yield from (clock.words() for clock in schedule.clocks)
    if schedule.order is not None:
        yield "the lines are not in the order of their times: they are put in that order"
    ahead_s = schedule.stamp_ahead_s
    if ahead_s is not None and abs(ahead_s) >= TOLD_STAMP_S:
        way = "ahead of" if ahead_s > 0 else "behind"
        yield (
            f"the time stamps are {abs(ahead_s):.0f} s {way} the sentences: they say when lines came, the sentences "
            "say the UTC"
        )
    if schedule.stamps_wander:
        yield "the time stamps wander: the sentences say better when their lines came, and are followed"
    for jump in schedule.sets:
        way = "back" if jump.seconds < 0 else "ahead"
        where = f"before line {numbers[jump.line]}"
        yield f"the clock is set {way} by {abs(jump.seconds):g} s {where}: no time is taken to have passed"


def length_note(paced: Paced) -> str | None:
    """What a person should know of a recording that is much longer than its lines fill."""
    schedule = paced.schedule
    long_s = schedule.at_ns[-1] / NS_PER_S
    silent_s = sum(gap.seconds for gap in schedule.gaps)
    if 2 * silent_s <= long_s or not schedule.gaps:
        return None
    longest = max(schedule.gaps, key=lambda gap: gap.seconds)
    gap = f"{longest.seconds:.0f} s before line {paced.recording.numbers[longest.line]}"
    return f"of {long_s:.0f} s its lines fill {long_s - silent_s:.0f} s: the longest gap is {gap}"


def before_gps(paced: Paced) -> bool:
    """True when its date is from before GPS was complete."""
    utc_ms = paced.schedule.first_utc_ms
    return utc_ms is not None and utc_ms * NS_PER_MS < EARLIEST_ARCHIVE_NS


def date_note(paced: Paced, config: BoatConfig) -> str | None:
    """What a person should know of a date that only a receiver gives that lost its weeks."""
    utc_ms = paced.schedule.first_utc_ms
    if utc_ms is None or not before_gps(paced) or any(sensor.week_rollover for sensor in config.sensor):
        return None
    day = datetime.fromtimestamp(utc_ms / 1_000, UTC).date()
    return (
        f"the date, {day}, is before GPS was complete: if the receiver lost 1024 weeks or twice as many, set "
        "week_rollover = true at its [[sensor]] in a boat's file and give that with --config"
    )
