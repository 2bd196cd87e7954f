"""One known voyage, and a table that is written of it by a template."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import Final

ROWS: Final = 48
BEGIN: Final = datetime(2026, 5, 12, 10, 8, tzinfo=UTC)
SPEED_M_S: Final = 2.5
VIGO: Final = (42.23, -8.74)
LEAP_S: Final = 18
"""GPS time less UTC since 2017, s."""
_MINUTE_M: Final = 1852.0


class Angle:
    """Parts of a latitude or longitude: sign, degrees, minutes, seconds and letter."""

    def __init__(self, degrees: float, letters: str) -> None:
        self.value = degrees
        self.h = letters[degrees < 0.0]
        self.sign = "-" if degrees < 0.0 else ""
        self.abs = abs(degrees)
        self.d, self.m = int(self.abs), self.abs % 1.0 * 60.0
        self.mi, self.s = int(self.m), self.m % 1.0 * 60.0
        self.packed = self.d * 100.0 + self.m
        self.minutes = degrees * 60.0
        self.e7 = round(degrees * 1e7)
        self.rad = math.radians(degrees)
        self.e6 = round(degrees * 1e6)
        self.semi = round(degrees / 180.0 * 2**31)


@dataclass(frozen=True)
class Row:
    """The truth of one row; course and heading are the same: no leeway, no current."""

    k: int
    t: datetime
    lat_deg: float
    lon_deg: float
    cog: float
    rate: float
    """Yaw rate, deg/s, + to starboard."""
    kn: float = SPEED_M_S / 1852.0 * 3600.0

    @cached_property
    def lat(self) -> Angle:
        return Angle(self.lat_deg, "NS")

    @cached_property
    def lon(self) -> Angle:
        return Angle(self.lon_deg, "EW")

    def fields(self) -> dict[str, object]:
        """What a template may name."""
        unix = self.t.timestamp()
        midnight = self.t.replace(hour=0, minute=0, second=0, microsecond=0)
        gps_s = round(unix) - 315_964_800 + LEAP_S
        yaw = math.radians(self.cog) / 2.0
        ros = math.radians(90.0 - self.cog) / 2.0
        return {
            "k": self.k, "t": self.t, "lt": self.t + timedelta(hours=2), "gt": self.t + timedelta(seconds=LEAP_S),
            "lat": self.lat, "lon": self.lon, "cog": self.cog, "rate": self.rate, "kn": self.kn, "m_s": SPEED_M_S,
            "kmh": SPEED_M_S * 3.6, "mph": SPEED_M_S / 0.44704, "unix": round(unix),
            "ms": 1_000_000 + self.k * 1000, "frac": (unix - midnight.timestamp()) / 86400.0,
            "excel": unix / 86400.0 + 25_569, "excel0": round(midnight.timestamp() / 86400.0) + 25_569,
            "matlab": unix / 86400.0 + 719_529, "julian": unix / 86400.0 + 2_440_587.5,
            "since_1904": round(unix) + 2_082_844_800, "since_2001": round(unix) - 978_307_200,
            "fit": round(unix) - 631_065_600, "mmss": f"{self.k // 60:02d}:{self.k % 60:02d}",
            "hms_int": int(self.t.strftime("%H%M%S")), "cdeg": round(self.cog * 100), "ckn": round(self.kn * 100),
            "gps": gps_s, "week": gps_s // 604_800, "tow": gps_s % 604_800,
            "ve": SPEED_M_S * math.sin(math.radians(self.cog)), "vn": SPEED_M_S * math.cos(math.radians(self.cog)),
            "ay": SPEED_M_S * math.radians(self.rate), "rad": math.radians(self.cog), "rad_s": math.radians(self.rate),
            "qz": math.sin(yaw), "qw": math.cos(yaw), "rz": math.sin(ros), "rw": math.cos(ros),
            "back": (self.cog + 180.0) % 360.0, "enu": (90.0 - self.cog) % 360.0,
            "lon360": self.lon_deg % 360.0, "west_minutes": -self.lon_deg * 60.0,
            "hms": self.t.strftime("%H%M%S"), "dmy": int(self.t.strftime("%d%m%y")),
        }  # fmt: skip


def voyage(
    begin: datetime = BEGIN,
    place: tuple[float, float] = VIGO,
    rows: int = ROWS,
    *,
    cog: float = 40.0,
    turn: bool = True,
) -> list[Row]:
    """One row a second: straight, then a turn to starboard, then to port."""
    made, (lat, lon) = [], place
    for k in range(rows):
        rate = (4.0 if k % 32 < 16 else -3.0) if turn and k > 8 else 0.0
        made.append(Row(k, begin + timedelta(seconds=k), lat, lon, cog % 360.0, rate))
        lat += SPEED_M_S * math.cos(math.radians(cog + rate / 2.0)) / _MINUTE_M / 60.0
        lon += SPEED_M_S * math.sin(math.radians(cog + rate / 2.0)) / _MINUTE_M / 60.0 / math.cos(math.radians(lat))
        cog += rate
    return made


@dataclass(frozen=True)
class Table:
    """One input."""

    head: str
    row: str
    """A template of `str.format` with the names of `Row.fields`."""
    right: str = "read"
    """`read`, `asked` (refused with both lines), `refused` (one sentence), or `safe` (any of the three)."""
    parts: str = "fix sog cog"
    """What a right reading brings."""
    has_utc: bool = True
    """False = nothing in the file says the day, or that it is UTC."""
    rows: Sequence[Row] = ()
    order: Callable[[list[str]], list[str]] = list
    encoding: str = "utf-8"
    magnetic: bool = False
    name: str = "in.csv"

    @property
    def truth(self) -> Sequence[Row]:
        return self.rows or voyage()

    def data(self) -> bytes:
        lines = [self.row.format(**row.fields()) for row in self.truth]
        text = "\n".join([*([self.head] if self.head else []), *self.order(lines)]) + "\n"
        return text.encode(self.encoding)
