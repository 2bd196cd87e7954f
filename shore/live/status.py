"""The one status line a second: every number with its age, source and quality; a stale one says so."""

from math import hypot
from typing import Final, TypeVar

from common.boat_start import BoatStart
from common.messages import Fix, Frame, Heading
from common.sensors import BoatConfig, stale_after_s
from common.units import NS_PER_S
from shore.navigation.estimate import Estimate
from shore.pipeline import Output

_QUALITY = {1: "GPS", 2: "DGPS", 3: "PPS", 4: "RTK fixed", 5: "RTK float"}
"""GGA quality of fixes that are fused."""


STALE_ESTIMATE_S: Final = 2.0

_Item = TypeVar("_Item")


class StatusLine:
    """Remembers the newest of everything; `text` is pure."""

    def __init__(self, config: BoatConfig, shown_filter: str) -> None:
        self._config = config
        self._filter = shown_filter
        self._start: BoatStart | None = None
        self._forget()

    def _forget(self) -> None:
        self.t_ns = 0
        """Boat time of the newest frame."""
        self._fix: Fix | None = None
        self._heading: Heading | None = None
        self._estimate: Estimate | None = None
        self._waiting: tuple[str, ...] = ()

    def take(self, frame: Frame, output: Output) -> None:
        """One frame, in any order, and what the pipeline made of it."""
        start = BoatStart.of(frame)
        newest = self._start or start
        if start.is_before(newest):
            return
        if start.clock_id != newest.clock_id:
            self._forget()  # the board was rebooted: its time begins again
        self._start = newest.followed_by(frame)
        self.t_ns = max(self.t_ns, frame.t1_ns)
        self._fix = max((*frame.fixes, *_if_any(self._fix)), key=_time, default=None)
        self._heading = max((*frame.headings, *_if_any(self._heading)), key=_time, default=None)
        self._estimate = next((item for item in output.estimates if item.filter == self._filter), self._estimate)
        self._waiting = self._waiting if output.waiting is None else output.waiting

    def text(self, received: int, missing: int, gone: int = 0) -> str:
        """The line: estimate | newest fix | newest heading | frames. T = true, M = magnetic, (age).

        missing: still to come; gone: not held by the boat any more.
        """
        counts = f"{received} frames, {missing} missing" + (f", {gone} lost" if gone else "")
        return f"{self._estimate_text()} | {self._fix_text()} | {self._heading_text()} | {counts}"

    def _estimate_text(self) -> str:
        estimate = self._estimate
        waiting = f" waiting for: {', '.join(self._waiting)}" if self._waiting else ""
        if estimate is None:
            return f"{self._filter}{waiting or ' waits'}"
        sigma_m = hypot(estimate.sigma_east_m, estimate.sigma_north_m)
        heading = f"{_tenths(estimate.heading_true_deg)}°T ±{estimate.sigma_heading_deg:.1f}°"
        place = position_text(estimate.lat_deg, estimate.lon_deg)
        age_s = (self.t_ns - estimate.t_ns) / NS_PER_S
        stale = f" STALE ({age_s:.0f} s)" if age_s > STALE_ESTIMATE_S else ""
        return f"{self._filter} {place} ±{sigma_m:.1f} m  {heading}  {estimate.sog_kn:.1f} kn{stale}{waiting}"

    def _fix_text(self) -> str:
        fix = self._fix
        if fix is None:
            return "no fix yet"
        quality = "position repeated, not used" if fix.held else "not usable"
        if fix.usable:
            quality = "fix" if fix.fix_quality is None else _QUALITY.get(fix.fix_quality, "fix")
        return f"{fix.sensor} {quality} {self._age_text(fix.sensor, fix.t_ns)}"

    def _heading_text(self) -> str:
        heading = self._heading
        if heading is None:
            return "no heading yet"
        value, letter = heading.heading_true_deg, "T"
        if value is None:
            value, letter = heading.heading_mag_deg, "M"
        text = "no value" if value is None else f"{_tenths(value)}°{letter}"
        return f"{heading.sensor} {text} {self._age_text(heading.sensor, heading.t_ns)}"

    def _age_text(self, sensor: str, t_ns: int) -> str:
        age_s = (self.t_ns - t_ns) / NS_PER_S
        table = next((item for item in self._config.sensor if item.id == sensor), None)
        stale = table is not None and age_s > stale_after_s(table.role, table.rate_hz)
        return f"STALE ({age_s:.0f} s)" if stale else f"({age_s:.1f} s)"


def _if_any(item: _Item | None) -> tuple[_Item, ...]:
    return () if item is None else (item,)


def _time(item: Fix | Heading) -> int:
    return item.t_ns


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
