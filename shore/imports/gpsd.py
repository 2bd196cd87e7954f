"""Reader of gpsd's JSON, one object a line (`gpspipe -w`, or with raw sentences or time stamps beside it).

TPV -> Fix, ATT -> Heading or Attitude and TurnRate, IMU -> the same and ImuSample; other classes are counted. Raw
sentences are passed over: what gpsd made of them stands beside them. Fields: gpsd_json(5).
"""

import json
from collections.abc import Iterable, Iterator
from typing import Any, Final

from common.boat_config import BoatTable, SensorTable
from common.framer import ImuSample, Measurement
from common.messages import Attitude, Fix, Heading, TurnRate
from common.units import M_S_PER_KN, NS_PER_MS
from shore.imports.frames import PORT
from shore.imports.line_counts import Account, Rejected
from shore.imports.reader import ForeignRecord, Sources
from shore.imports.values import direction_deg, number, signed_deg, utc_ns_of

_QUALITY_OF: Final[dict[int, int]] = {1: 1, 2: 2, 3: 4, 4: 5, 5: 6, 6: 6, 7: 7, 8: 8, 9: 3}
"""Quality of GGA for each status of gpsd: RTK fixed and floating, dead reckoning, surveyed (manual), simulated, P(Y)
(PPS)."""
DAY_MS: Final = 86_400_000
LARGEST: Final = 1e6
MOST_WAITING: Final = 50
"""Most objects between two TPVs of one receiver and epoch; with more between them they are two epochs."""


class GpsdReader:
    """Reader of a gpsd JSON file."""

    def __init__(self, lines: Iterable[str]) -> None:
        self.account = Account("lines")
        self.accounts: tuple[Account, ...] = (self.account,)
        self.boat = BoatTable(id="gpsd")
        self.is_utc = True
        self.notes: list[str] = []
        self.sources = Sources()
        self._lines = lines
        self._before: dict[str, dict[str, float]] = {}

    def records(self) -> Iterator[ForeignRecord]:
        """Records: one for each TPV, ATT and IMU; of the TPVs of one epoch of a receiver the last."""
        waiting: list[ForeignRecord] = []
        for line in self._lines:
            record = self._record(line)
            if record is None:
                continue
            same = next((place for place, before in enumerate(waiting) if _same_epoch(before, record)), None)
            if same is not None:
                self.account.ignored["TPV of the same epoch"] += 1
                waiting[same] = record
                continue
            if len(waiting) >= MOST_WAITING or any(_next_epoch(before, record) for before in waiting):
                yield from waiting
                waiting.clear()
            waiting.append(record)
        yield from waiting

    def measure(self, record: ForeignRecord, t_ns: int) -> Iterator[Measurement]:
        """The measurements of one object; a whole object is refused where any field of it is impossible."""
        kind, device = record.content["class"], str(record.content.get("device", ""))
        try:
            made = self._fix(record, device, t_ns) if kind == "TPV" else self._motion(record, device, t_ns)
        except Rejected as reason:
            self.account.rejected[f"{kind} {reason}"] += 1
            return
        if made:
            self.account.taken[kind] += 1
        else:
            self.account.ignored[f"{kind} without a value"] += 1
        yield from made

    def leave_out(self, record: ForeignRecord, reason: str) -> None:
        """Count an object that is left out."""
        self.account.rejected[f"{record.content['class']} {reason}"] += 1

    def sensors(self, rates_hz: dict[str, float | None]) -> tuple[SensorTable, ...]:
        """Sensors of the file, one for each device and role."""
        return self.sources.tables(PORT, rates_hz)

    def _record(self, line: str) -> ForeignRecord | None:
        begin = line.find("{")
        if begin < 0 or line[0] in "$!#":
            kind = "comment" if line[0] == "#" else "raw sentence" if line[0] in "$!" else "other text"
            self.account.ignored[kind] += 1
            return None
        try:
            content = json.loads(line[begin:])
        except (ValueError, RecursionError):
            self.account.rejected["no JSON"] += 1
            return None
        kind = content.get("class")
        if kind not in ("TPV", "ATT", "IMU"):
            self.account.ignored[str(kind)[:16] if isinstance(kind, str) else "no class"] += 1
            return None
        if kind == "TPV" and not ("lat" in content or "speed" in content or "time" in content):
            self.account.ignored["TPV without a value"] += 1
            return None
        try:
            return ForeignRecord(utc_ns_of(content.get("time")), content, str(content.get("device", "")))
        except Rejected as reason:
            self.account.rejected[f"{kind} {reason}"] += 1
            return None

    def _fix(self, record: ForeignRecord, device: str, t_ns: int) -> tuple[Measurement, ...]:
        tpv = record.content
        mode, status = number(tpv, "mode", 0, 3), number(tpv, "status", 0, 100)
        lat_deg, lon_deg = number(tpv, "lat", -90.0, 90.0), number(tpv, "lon", -180.0, 180.0)
        speed_m_s = number(tpv, "speed", 0.0, 1000.0 * M_S_PER_KN)
        alt_m = number(tpv, "altMSL" if "altMSL" in tpv else "alt", -LARGEST, LARGEST)
        course_deg = direction_deg(tpv, "track")
        if (lat_deg is None) != (lon_deg is None):
            raise Rejected("half a position")
        if lat_deg is None and speed_m_s is None and record.t_ns is None:
            return ()
        return (
            Fix(
                sensor=self.sources.id_of("gps", device),
                t_ns=t_ns,
                lat_deg=lat_deg,
                lon_deg=lon_deg,
                alt_m=alt_m if lat_deg is not None else None,
                fix_quality=None if status is None else _QUALITY_OF.get(int(status)),
                fix_mode=int(mode) if mode in (1.0, 2.0, 3.0) else None,
                sog_kn=None if speed_m_s is None else speed_m_s / M_S_PER_KN,
                cog_true_deg=course_deg,
                utc_ns=record.t_ns,
                tod_ms=None if record.t_ns is None else record.t_ns // NS_PER_MS % DAY_MS,
            ),
        )

    def _motion(self, record: ForeignRecord, device: str, t_ns: int) -> tuple[Measurement, ...]:
        said, imu_sample = _angles(record.content), self._imu_sample(record.content, device, t_ns)
        # gpsd repeats the angles that other sentences brought. Where none changed, all are new.
        before, self._before[device] = self._before.get(device, {}), said
        news = {name: value for name, value in said.items() if before.get(name) != value} or said
        made: list[Measurement] = []
        roll_deg, pitch_deg, yaw_deg = (news.get(name) for name in ("roll", "pitch", "yaw"))
        true_deg, mag_deg = news.get("heading"), news.get("mheading")
        is_new, leans = true_deg is not None or mag_deg is not None, {"roll", "pitch", "yaw"} & news.keys()
        is_compass = is_new or ("compass", device) in self.sources.names
        if is_new:
            sensor = self.sources.id_of("compass", device)
            # Magnetic or true, never both: true is made of the other.
            mag_deg = mag_deg if true_deg is None else None
            made.append(
                Heading(
                    sensor=sensor,
                    t_ns=t_ns,
                    heading_true_deg=true_deg,
                    heading_mag_deg=mag_deg,
                    pitch_deg=pitch_deg,
                    roll_deg=roll_deg,
                )
            )
        elif leans:
            sensor = self.sources.id_of("compass" if is_compass else "imu", device)
            made.append(Attitude(sensor=sensor, t_ns=t_ns, roll_deg=roll_deg, pitch_deg=pitch_deg, yaw_deg=yaw_deg))
        if (turn_deg_min := news.get("rot")) is not None:
            sensor = self.sources.id_of("compass" if is_compass else "gyro", device)
            made.append(TurnRate(sensor=sensor, t_ns=t_ns, rate_deg_s=turn_deg_min / 60.0))
        return (*made, *imu_sample)

    def _imu_sample(self, imu: dict[str, Any], device: str, t_ns: int) -> tuple[Measurement, ...]:
        fwd, stb = number(imu, "acc_x", -1e3, 1e3), number(imu, "acc_y", -1e3, 1e3)
        rate = number(imu, "gyro_z", -4000.0, 4000.0)
        if fwd is None or stb is None or rate is None:
            return ()
        return (ImuSample(self.sources.id_of("imu", device), t_ns, fwd, stb, rate),)


def _angles(att: dict[str, Any]) -> dict[str, float]:
    """Every angle (deg; rot: deg/min) that is said; raises Rejected when one of them is impossible."""
    found = {
        **{name: direction_deg(att, name) for name in ("heading", "mheading")},
        **{name: signed_deg(att, name) for name in ("pitch", "roll", "yaw")},
        "rot": number(att, "rot", -240_000.0, 240_000.0),
    }
    return {name: value for name, value in found.items() if value is not None}


def _same_epoch(before: ForeignRecord, record: ForeignRecord) -> bool:
    return before.t_ns is not None and before.t_ns == record.t_ns and _same_receiver(before, record)


def _next_epoch(before: ForeignRecord, record: ForeignRecord) -> bool:
    return before.t_ns != record.t_ns and _same_receiver(before, record)


def _same_receiver(before: ForeignRecord, record: ForeignRecord) -> bool:
    a, b = before.content, record.content
    return bool(a["class"] == b["class"] == "TPV" and a.get("device") == b.get("device"))
