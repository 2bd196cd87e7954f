"""CSV reader: a table and its column mapping, of which every row is taken as it is."""

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from io import TextIOWrapper
from pathlib import Path
from typing import Any, Final

from common.boat_config import SensorTable
from common.errors import WayfixError
from common.framer import ImuSample, Measurement
from common.geodesy import LocalPlane
from common.messages import Fix, Heading, TurnRate
from common.simulation.column_map import ColumnMap, FixColumns, HeadingColumns, ImuColumns
from common.units import NS_PER_MS, NS_PER_S, NS_PER_US
from shore.imports.csv_dialect import Table, rows_of, table_in
from shore.imports.frames import PORT
from shore.imports.gpsd import DAY_MS
from shore.imports.line_counts import Account, Rejected
from shore.imports.reader import ForeignRecord, Sources, opened
from shore.imports.recognise import HEAD_BYTES
from shore.imports.record_times import LATEST_NS
from shore.imports.values import direction_deg, in_range, utc_ns_of

Row = dict[str, str]
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_NOTHING: Final = ("", "nan", "NaN", "NAN", "null", "None", "NA")


class ColumnReader:
    """Reader of one table. A row without time is rejected; of the others each part is counted for itself."""

    def __init__(self, path: Path, mapping: ColumnMap, progress: Callable[[int], None] | None = None) -> None:
        """Raises WayfixError for columns that are not there."""
        self.mapping = mapping
        self.boat = mapping.boat
        self._zero_ns = utc_ns_of(mapping.time.zero_utc) or 0
        self.is_utc = mapping.time.unix or mapping.time.utc or mapping.time.zero_utc is not None
        self.notes: list[str] = []
        self.sources = Sources()
        self._path = path
        self._progress = progress
        self._rows = Account("rows")
        self._table = _table(path, mapping)
        self._parts = [
            (part, name, make, Account(f"rows for {name}"))
            for part, name, make in (
                (mapping.fix, "fix", self._fix),
                (mapping.heading, "heading", self._heading),
                (mapping.imu, "imu", self._imu),
            )
            if part is not None
        ]
        self.accounts = (self._rows, *(account for _, _, _, account in self._parts))
        self._before: dict[str, Any] = {}
        """The columns of each part as they were in the row before."""
        fix = mapping.fix
        self._plane: LocalPlane | None = None
        if fix is not None and fix.origin_lat_deg is not None and fix.origin_lon_deg is not None:
            self._plane = LocalPlane(fix.origin_lat_deg, fix.origin_lon_deg)
        if any(getattr(part, name, 0.0) for part in (fix, mapping.heading) for name in ("noise_m", "noise_deg")):
            self.notes.append("the mapping's noise is for the virtual boat: none was added")

    def records(self) -> Iterator[ForeignRecord]:
        """Records of the table, one for each row."""
        wraps = 0
        before_ns: int | None = None
        wraps_ns = round(self.mapping.time.wraps_s * NS_PER_S)
        with opened(self._path) as stream, TextIOWrapper(stream, "utf-8-sig", errors="replace", newline="") as text:
            told = 0
            for row in rows_of(text, self._table):
                if self._progress and (now := stream.tell()) > told:
                    self._progress(now - told)
                    told = now
                if row is None:
                    self._rows.rejected["no row of CSV"] += 1
                    continue
                try:
                    t_ns = self._time_ns(row)
                except Rejected as reason:
                    self._rows.rejected[f"time: {reason}"] += 1
                    continue
                if wraps_ns and before_ns is not None and t_ns < before_ns - wraps_ns // 2:
                    wraps += 1
                before_ns = t_ns
                yield ForeignRecord(min(t_ns + wraps * wraps_ns, LATEST_NS), row)

    def measure(self, record: ForeignRecord, t_ns: int) -> Iterator[Measurement]:
        """Measurements of a row, up to one of each part."""
        self._rows.taken["with time"] += 1
        for part, name, make, account in self._parts:
            try:
                made = make(record, t_ns)
            except Rejected as reason:
                account.rejected[str(reason)] += 1
                continue
            if made is None:
                account.ignored["empty"] += 1
            elif part.held and self._before.get(name) == made[0]:
                account.ignored["the same as before"] += 1
            else:
                account.taken[type(made[1]).__name__] += 1
                yield made[1]
            if made is not None:
                self._before[name] = made[0]

    def leave_out(self, _: ForeignRecord, reason: str) -> None:
        """Count a row that is left out."""
        self._rows.rejected[f"time: {reason}"] += 1

    def sensors(self, rates_hz: dict[str, float | None]) -> tuple[SensorTable, ...]:
        """Sensors of the table, one for each part, with what the mapping's `[facts]` say of them."""
        facts = asdict(self.mapping.facts)
        return tuple(
            SensorTable(id=f"{role}1", port=PORT, role=role, rate_hz=rates_hz[f"{role}1"], **facts)
            for role in ("gps", "compass", "imu", "gyro")
            if f"{role}1" in rates_hz
        )

    def _time_ns(self, row: Row) -> int:
        time = self.mapping.time
        text = row[time.column]
        if time.format is not None:
            joined = " ".join([text, *(row[name] for name in time.more)])
            try:
                moment = datetime.strptime(joined, time.format)  # noqa: DTZ007 (made UTC below)
            except ValueError:
                raise Rejected("empty" if not joined.strip() else "not in the form of the mapping") from None
            moment = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment
            since = moment - _EPOCH
            return ((since.days * 86_400 + since.seconds) * 1_000_000 + since.microseconds) * NS_PER_US
        seconds = _decimal(self._with_point(text)) * Decimal(repr(time.scale))
        if time.nanoseconds is not None:
            seconds += _decimal(row[time.nanoseconds]) / NS_PER_S
        if not -4_000_000_000 <= seconds <= 4_000_000_000:
            raise Rejected("out of range")
        return self._zero_ns + int(seconds * 1_000_000) * NS_PER_US

    def _with_point(self, text: str) -> str:
        """A number as Python reads it: where no comma parts the columns, it may part the decimals."""
        return text if self._table.delimiter == "," or "." in text else text.replace(",", ".")

    def _number(self, row: Row, column: str | None) -> float | None:
        """The number in a field; `None` = empty; raises Rejected for text."""
        text = "" if column is None else row[column]
        if text in _NOTHING:
            return None
        try:
            value = float(self._with_point(text))
        except ValueError:
            raise Rejected("not a number") from None
        return value if math.isfinite(value) else None

    def _fix(self, record: ForeignRecord, t_ns: int) -> tuple[Any, Measurement] | None:
        fix, row = self.mapping.fix, record.content
        assert isinstance(fix, FixColumns)
        place = self._place(fix, row)
        if place is None:
            return None
        lat_deg, lon_deg = in_range(place[0], "lat", -90.0, 90.0), in_range(place[1], "lon", -180.0, 180.0)
        sog, mode = self._number(row, fix.sog), self._number(row, fix.mode)
        course = direction_deg({"cog": self._number(row, fix.cog)}, "cog")
        utc_ns = record.t_ns if self.is_utc and record.t_ns is not None and record.t_ns >= 0 else None
        return place, Fix(
            sensor="gps1",
            t_ns=t_ns,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_m=self._number(row, fix.alt),
            fix_mode=int(mode) if mode in (1.0, 2.0, 3.0) else None,
            sog_kn=in_range(None if sog is None else sog * fix.sog_scale, "sog", 0.0, 1000.0),
            cog_true_deg=course,
            utc_ns=utc_ns,
            tod_ms=None if utc_ns is None else utc_ns // NS_PER_MS % DAY_MS,
        )

    def _place(self, fix: FixColumns, row: Row) -> tuple[float, float] | None:
        if self._plane is not None:
            north_m, east_m = self._number(row, fix.north), self._number(row, fix.east)
            if north_m is None or east_m is None:
                return None
            if math.hypot(north_m, east_m) > 50_000.0:
                raise Rejected("too far from the origin")
            return self._plane.to_lat_lon_deg(east_m, north_m)
        lat, lon = self._number(row, fix.lat), self._number(row, fix.lon)
        return None if lat is None or lon is None else (lat * fix.scale, lon * fix.scale)

    def _heading(self, record: ForeignRecord, t_ns: int) -> tuple[Any, Measurement] | None:
        heading, row = self.mapping.heading, record.content
        assert isinstance(heading, HeadingColumns)
        if heading.quaternion:
            parts = [self._number(row, name) for name in heading.quaternion]
            if None in parts:
                return None
            x, y, z, w = (part for part in parts if part is not None)
            if not 0.9 < x * x + y * y + z * z + w * w < 1.1:
                raise Rejected("no unit quaternion")
            value: float | None = math.degrees(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
        else:
            value = self._number(row, heading.column)
        if value is None:
            return None
        raw_deg = in_range(value * heading.scale, "heading", -361.0, 361.0)
        assert raw_deg is not None
        found = math.fmod(raw_deg + heading.offset_deg + 720.0, 360.0)
        mag_deg, true_deg = (found, None) if heading.magnetic else (None, found)
        return value, Heading(sensor="compass1", t_ns=t_ns, heading_mag_deg=mag_deg, heading_true_deg=true_deg)

    def _imu(self, record: ForeignRecord, t_ns: int) -> tuple[Any, Measurement] | None:
        imu, row = self.mapping.imu, record.content
        assert isinstance(imu, ImuColumns)
        rate = self._number(row, imu.yaw_rate)
        if rate is None:
            return None
        rate_deg_s = in_range(rate * imu.yaw_rate_scale, "yaw rate", -4000.0, 4000.0)
        assert rate_deg_s is not None
        if imu.accel_fwd is None:
            return rate, TurnRate(sensor="gyro1", t_ns=t_ns, rate_deg_s=rate_deg_s)
        fwd, stb = self._number(row, imu.accel_fwd), self._number(row, imu.accel_stb)
        if fwd is None or stb is None:
            return None
        stb_scale = imu.accel_scale if imu.accel_stb_scale is None else imu.accel_stb_scale
        fwd_m_s2 = in_range(fwd * imu.accel_scale, "accel_fwd", -1000.0, 1000.0)
        stb_m_s2 = in_range(stb * stb_scale, "accel_stb", -1000.0, 1000.0)
        assert fwd_m_s2 is not None
        assert stb_m_s2 is not None
        return (fwd, stb, rate), ImuSample("imu1", t_ns, fwd_m_s2, stb_m_s2, rate_deg_s)


def _table(path: Path, mapping: ColumnMap) -> Table:
    with opened(path) as stream:
        table = table_in(stream.read(HEAD_BYTES))
    if table is None:
        raise WayfixError("is no table", str(path), "give a CSV file with a line of column names")
    missing = [name for name in mapping.columns if name not in table.columns]
    if missing:
        known = ", ".join(name for name in table.columns if name)
        raise WayfixError(f"has no column {', '.join(missing)}", str(path), f"correct the mapping; it has: {known}")
    return table


def _decimal(text: str) -> Decimal:
    if text in _NOTHING:
        raise Rejected("empty")
    try:
        value = Decimal(text)
    except InvalidOperation:
        raise Rejected("not a number") from None
    if not value.is_finite():
        raise Rejected("not a number")
    return value
