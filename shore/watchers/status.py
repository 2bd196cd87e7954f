"""Status line, one a second: every number has its age, source and quality, and a stale one is marked as stale.

On a terminal it is one line: where it is too long, first what is well is left out, then what is said elsewhere.
"""

from collections.abc import Callable
from datetime import UTC, datetime
from math import hypot
from typing import Final

from common.clock import BoatClock
from common.units import NS_PER_S
from common.words import counted
from shore.link.catching_up import CatchingUp
from shore.navigation.basis import COASTING, COURSE
from shore.navigation.estimate import MOST_DOUBT_M, Estimate
from shore.settings.station import DEFAULTS, StationSettings
from shore.terminal import width_of_stderr
from shore.watchers.newest import Age, Newest, quality_of
from shore.watchers.watcher import SourceState, Start, Step, Watcher

_UNWELL: Final = {"STALE", "no", "not"}
"""Words of a sensor that is not well, which is said on any terminal."""


class StatusLine(Watcher):
    """Remembers the newest of everything, and says a line of it each second."""

    def __init__(
        self,
        shown_filter: str,
        say: Callable[[str], None],
        settings: StationSettings = DEFAULTS,
        width: Callable[[], int | None] = width_of_stderr,
        boat_seconds_per_s: float = 1.0,
    ) -> None:
        """width: of the terminal, characters; `None` = as long as it is.

        boat_seconds_per_s: how fast the boat's clock runs beside the station's.
        """
        self._clock = BoatClock(boat_seconds_per_s)
        self._width = width
        self._filter = shown_filter
        self._say = say
        self._settings = settings
        self.newest: Newest | None = None
        """The newest values; `None` before the session began."""

    def begin(self, start: Start, t_ns: int) -> None:
        """Forget everything when the configuration is another one."""
        self.newest = Newest(start.config, self._filter, self._settings.limits, self._now_s)

    def _now_s(self) -> float:
        return self._clock.now_ns() / NS_PER_S

    def take(self, step: Step) -> None:
        """Take one frame, in any order."""
        if self.newest is not None:
            self.newest.take(step.frame, step.output)

    def each_second(self, now: SourceState) -> None:
        """Print the line, where one is wanted."""
        if self.newest is None:
            return
        self.newest.board_now = now.board_now
        if self._settings.display.status_line:
            self._say(status_text(self.newest, now, self._width()))


def status_text(newest: Newest, now: SourceState, width: int | None = None) -> str:
    """The line: estimate | newest fix | newest heading | frames. T = true, M = magnetic, (age).

    width: most characters of the line.
    """
    whole = _whole_text(newest, now)
    if width is None or len(whole) <= width:
        return whole
    estimate = _estimate_text(newest)
    sensors = [text for text in (_fix_text(newest), _heading_text(newest)) if not _UNWELL.isdisjoint(text.split())]
    missing, told = now.holes.brief(), _holes_text(now)
    trouble = [] if now.has_log else ["NO LOG"]
    trouble += [] if now.lost_s is None else [f"LINK LOST for {now.lost_s:.0f} s"]
    bare, *waiting = estimate.removeprefix(f"{newest.filter} ").split(" waiting for: ")
    if waiting:
        has_position = newest.estimate is not None and "position" in newest.estimate.aligned_parts
        bare += " (heading not valid)" if has_position else " (not valid yet)"
    shorter = (
        [*trouble, estimate, *sensors, told],
        [*trouble, estimate, *sensors, missing],
        [*trouble, bare, *sensors, missing],
        [*trouble, bare, *sensors],
    )
    texts = [" | ".join(parts) for parts in shorter]
    last = texts[-1]
    if "STALE" in last and "STALE" not in last[: width - 1]:
        last = f"STALE {last}"  # a line that is cut does not lose this word
    return next((text for text in texts if len(text) <= width), last[: width - 1] + "…")


def _whole_text(newest: Newest, now: SourceState) -> str:
    counts = f"{counted(now.received, 'frame')}, {_holes_text(now)}"
    text = f"{_estimate_text(newest)} | {_fix_text(newest)} | {_heading_text(newest)} | {counts}"
    if not now.has_log:
        text = f"NO LOG | {text}"
    if now.round_trip_ms is not None:
        text = f"{text} | round trip {now.round_trip_ms:.0f} ms"
    if now.lost_s is None:
        return text
    refusal = f" ({now.refusal})" if now.refusal else ""
    return f"LINK LOST for {now.lost_s:.0f} s{refusal}, trying again | before: {text}"


def _holes_text(now: SourceState) -> str:
    """What is not here; of frames that are still to come, where it is known, of which time and how soon."""
    brief = now.holes.brief()
    return (
        brief
        if now.catching_up is None
        else brief.replace(f"{now.missing:,} missing", catching_up_text(now.catching_up))
    )


def catching_up_text(lack: CatchingUp) -> str:
    """Catching up: 8,327 frames of 13:50 to 14:05, 1 min left. Times are UTC, seconds where it is about minutes."""
    text = f"catching up: {counted(lack.frames, 'frame')}"
    if lack.from_utc_ns is not None and lack.to_utc_ns is not None:
        form = "%H:%M" if lack.to_utc_ns - lack.from_utc_ns > 300 * NS_PER_S else "%H:%M:%S"
        begin, end = (datetime.fromtimestamp(ns // NS_PER_S, UTC) for ns in (lack.from_utc_ns, lack.to_utc_ns))
        text += f" of {begin:{form}} to {end:{form}}"
    if lack.left_s is None:
        return text
    return f"{text}, {lack.left_s:.0f} s left" if lack.left_s < 60.0 else f"{text}, {lack.left_s / 60:.0f} min left"


def _estimate_text(newest: Newest) -> str:
    estimate = newest.estimate
    waiting = f" waiting for: {', '.join(newest.waiting)}" if newest.waiting else ""
    if estimate is None:
        return f"{newest.filter}{waiting or ' waits'}"
    age = newest.age_of_estimate(estimate)
    stale = f" {_age_text(age)}" if age.is_stale else ""
    place, heading = _place_text(estimate), _estimated_heading(estimate)
    return f"{newest.filter} {place}  {heading}  {estimate.sog_kn:.1f} kn{stale}{waiting}"


def _place_text(estimate: Estimate) -> str:
    """The place with its doubt, and since when it is dead reckoning; none where the doubt is too large for one."""
    sigma_m = hypot(estimate.sigma_east_m, estimate.sigma_north_m)
    text = f"{position_text(estimate.lat_deg, estimate.lon_deg)} ±{sigma_m:.1f} m"
    if sigma_m > MOST_DOUBT_M:
        text = f"position unknown (±{sigma_m / 1000.0:.1f} km)"
    if estimate.position_from == COASTING:
        text += f" COASTING {(estimate.t_ns - estimate.position_since_ns) / NS_PER_S:.0f} s"
    return text


def _estimated_heading(estimate: Estimate) -> str:
    """The heading with its doubt, and what it comes from when that is no compass."""
    if estimate.heading_true_deg is None:
        return "heading unknown"
    words = {COURSE: " by COG", COASTING: " carried on"}.get(estimate.heading_from or "", "")
    return f"{_tenths(estimate.heading_true_deg)}°T ±{estimate.sigma_heading_deg:.1f}°{words}"


def _fix_text(newest: Newest) -> str:
    fix = newest.fix
    return "no fix yet" if fix is None else f"{fix.sensor} {quality_of(fix)} {_age_text(newest.age(fix))}"


def _heading_text(newest: Newest) -> str:
    heading = newest.heading
    if heading is None:
        return "no heading yet"
    value, letter = heading.heading_true_deg, "T"
    if value is None:
        value, letter = heading.heading_mag_deg, "M"
    text = "no value" if value is None else f"{_tenths(value)}°{letter}"
    return f"{heading.sensor} {text} {_age_text(newest.age(heading))}"


def _age_text(age: Age) -> str:
    return f"STALE ({age.s:.0f} s)" if age.is_stale else f"({age.s:.1f} s)"


def position_text(lat_deg: float, lon_deg: float) -> str:
    """50°45.612'N 001°17.402'W: degrees and minutes, as on a chart."""
    return f"{_angle_text(abs(lat_deg), 2)}{'NS'[lat_deg < 0]} {_angle_text(abs(lon_deg), 3)}{'EW'[lon_deg < 0]}"


def _tenths(heading_deg: float) -> str:
    """Three digits and a tenth; 359.96 is 000.0 and never 360.0."""
    return f"{round(heading_deg, 1) % 360.0:05.1f}"


def _angle_text(angle_deg: float, digits: int) -> str:
    # Rounded as thousandths of a minute first, so that 59.9996' becomes the next degree and never 60.000'.
    degrees, thousandths = divmod(round(angle_deg * 60_000), 60_000)
    return f"{degrees:0{digits}d}°{thousandths / 1000:06.3f}'"
