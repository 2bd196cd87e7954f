"""Reader of GPX tracks: each `trkpt` with a time is a fix; routes and waypoints are counted.

Points are put in order of time: devices write the current track before the saved ones, some the newest point first.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from common.boat_config import BoatTable, SensorTable
from common.errors import WayfixError
from common.framer import Measurement
from common.messages import Fix
from common.units import M_S_PER_KN, NS_PER_MS
from shore.imports.frames import PORT
from shore.imports.gpsd import DAY_MS
from shore.imports.line_counts import Account, Rejected
from shore.imports.reader import ForeignRecord, Sources
from shore.imports.values import direction_deg, in_range, utc_ns_of
from shore.report.gpx_points import GpxPoint, GpxPoints

_MODES: Final = {"none": 1, "2d": 2, "3d": 3, "dgps": 3, "pps": 3}
_OTHERS: Final = {"wpt": "waypoint", "rtept": "point of a route"}


class GpxReader:
    """Reader of one GPX file."""

    def __init__(self, path: Path, progress: Callable[[int], None] | None = None) -> None:
        self.account = Account("points")
        self.accounts: tuple[Account, ...] = (self.account,)
        self.boat = BoatTable(id="gpx")
        self.is_utc = True
        self.notes: list[str] = []
        self.sources = Sources()
        self._path = path
        self._progress = progress

    def records(self) -> Iterator[ForeignRecord]:
        """Records: one for each point of a track that has a time. Raises WayfixError for a track without any time."""
        points = GpxPoints(self._path, self._progress)
        timed: list[ForeignRecord] = []
        seen: set[tuple[int, str | None, str | None]] = set()
        count = 0
        for point in points:
            count += 1
            record = self._timed(point)
            if record is None or record.t_ns is None:
                continue
            if (record.t_ns, point.lat, point.lon) in seen:
                self.account.ignored["the same point again"] += 1
                continue
            seen.add((record.t_ns, point.lat, point.lon))
            timed.append(record)
        self.account.ignored.update({_OTHERS[kind]: number for kind, number in points.skipped.items()})
        if points.cut is not None:
            self.notes.append(f"the file is {points.cut}")
        if count and not timed:
            what = "is a track whose points have no times: a drawing, no recording"
            raise WayfixError(what, str(self._path), "give the track that the device recorded")
        yield from sorted(timed, key=lambda record: record.t_ns or 0)

    def measure(self, record: ForeignRecord, t_ns: int) -> Iterator[Measurement]:
        """The fix of a point."""
        point: GpxPoint = record.content
        try:
            fix = self._fix(point, record.t_ns, t_ns)
        except Rejected as reason:
            self.account.reject(str(reason), f"line {point.line}, {point}"[:200])
            return
        self.account.taken["Fix"] += 1
        yield fix

    def leave_out(self, record: ForeignRecord, reason: str) -> None:
        """Count a point that is left out."""
        self.account.reject(f"time: {reason}", f"line {record.content.line}, {record.content.time!r}")

    def sensors(self, rates_hz: dict[str, float | None]) -> tuple[SensorTable, ...]:
        """The receiver."""
        return self.sources.tables(PORT, rates_hz)

    def _timed(self, point: GpxPoint) -> ForeignRecord | None:
        try:
            t_ns = utc_ns_of(point.time)
        except Rejected as reason:
            self.account.reject(str(reason), f"line {point.line}, value {point.time!r}")
            return None
        if t_ns is None:
            self.account.reject("no time", f"line {point.line}")
            return None
        return ForeignRecord(t_ns, point)

    def _fix(self, point: GpxPoint, utc_ns: int | None, t_ns: int) -> Fix:
        lat_deg, lon_deg = _number(point.lat, "lat", -90.0, 90.0), _number(point.lon, "lon", -180.0, 180.0)
        if lat_deg is None or lon_deg is None:
            raise Rejected("no place")
        if lat_deg == lon_deg == 0.0:
            raise Rejected("place 0, 0: what a receiver without a fix writes")
        speed_m_s = _number(point.speed, "speed", 0.0, 500.0)
        fix = (point.fix or "").casefold()
        return Fix(
            sensor=self.sources.id_of("gps", "gpx"),
            t_ns=t_ns,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_m=_number(point.ele, "ele", -100_000.0, 100_000.0),
            fix_mode=_MODES.get(fix),
            fix_quality=2 if fix == "dgps" else None,
            sog_kn=None if speed_m_s is None else speed_m_s / M_S_PER_KN,
            cog_true_deg=direction_deg({"course": _number(point.course, "course", -180.0, 361.0)}, "course"),
            utc_ns=utc_ns,
            tod_ms=None if utc_ns is None else utc_ns // NS_PER_MS % DAY_MS,
        )


def _number(text: str | None, name: str, low: float, high: float) -> float | None:
    """A number of XML; `None` = it is not there; raises Rejected."""
    if text is None:
        return None
    try:
        return in_range(float(text), name, low, high)
    except ValueError:
        raise Rejected(f"{name}: not a number") from None
