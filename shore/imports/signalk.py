"""Reader of Signal K deltas, one a line, alone or in a server's log (`<ms or ISO time>;<provider>;<delta>`).

Of the boat's own vessel: navigation.position, speedOverGround and courseOverGroundTrue of one source and moment are one
Fix; headingTrue and headingMagnetic with magneticVariation a Heading; rateOfTurn a TurnRate; attitude an Attitude.
SI units: rad, m/s; roll + to starboard, pitch + bow up, rate of turn + to starboard (keys reference of Signal K 1.x).
"""

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from common.boat_config import BoatTable, SensorTable
from common.errors import WayfixError
from common.framer import Measurement
from common.messages import Attitude, Fix, Heading, TurnRate
from common.units import M_S_PER_KN, NS_PER_MS, NS_PER_S
from shore.imports.frames import PORT
from shore.imports.gpsd import DAY_MS, LARGEST
from shore.imports.line_counts import Account, Rejected
from shore.imports.reader import ForeignRecord, Sources
from shore.imports.recognise import SERVER_LINE
from shore.imports.values import direction_deg, number, signed_deg, utc_ns_of, within_life

DEG: Final = 180.0 / math.pi
SELF: Final = "vessels.self"
NOBODY: Final = "nobody"
NO_VESSELS: Final = ("atons.", "aircraft.", "sar.")
MOST_NAMED: Final = 8
DERIVED: Final = "derived-data"
"""Name of a server plugin that computes values from others: they repeat a measurement."""
OVER_NS: Final = 200 * NS_PER_MS
"""Values of one moment of a source come closer together than this, ns."""
_NAVIGATION: Final = "navigation."
PATHS: Final = (
    "position",
    "speedOverGround",
    "courseOverGroundTrue",
    "headingTrue",
    "headingMagnetic",
    "magneticVariation",
    "rateOfTurn",
    "attitude",
)


@dataclass(slots=True)
class SourceValues:
    """The values of one source at one time, by path without `navigation.`."""

    source: str
    t_ns: int | None
    values: dict[str, Any] = field(default_factory=dict)


class _Update(NamedTuple):
    context: str
    source: str
    t_ns: int | None
    values: list[Any]


def stamp_ns(text: str) -> int:
    """The time of a line of a server's log; raises Rejected."""
    if not text.isdigit():
        found = utc_ns_of(text)
        assert found is not None
        return found
    return within_life(int(text) * (NS_PER_MS if len(text) > 11 else NS_PER_S), "time")


class SignalKReader:
    """Reader of deltas."""

    def __init__(self, lines: Iterable[str], own: tuple[str, ...]) -> None:
        """Own: the contexts of the boat itself (`own_contexts`)."""
        self.account = Account("values")
        self.accounts: tuple[Account, ...] = (self.account,)
        self.boat = BoatTable(id="signalk")
        self.is_utc = True
        self.notes: list[str] = []
        self.sources = Sources()
        self._lines = lines
        self._own = own
        self._variation_deg: dict[str, float] = {}

    def records(self) -> Iterator[ForeignRecord]:
        """One for each source and time: values of one moment may come in several updates."""
        open_moments: dict[str, SourceValues] = {}
        for update in _updates(self._lines, self.account):
            if update.context not in self._own:
                self.account.ignored["of another vessel"] += max(1, len(update.values))
                continue
            yield from _closed(open_moments, update)
            if values := self._own_values(update):
                open_moments.setdefault(update.source, SourceValues(update.source, update.t_ns))
                yield from self._merge(open_moments, update, values)
        for moment in sorted(open_moments.values(), key=lambda moment: moment.t_ns or 0):
            yield ForeignRecord(moment.t_ns, moment, moment.source)

    def _merge(
        self, open_moments: dict[str, SourceValues], update: _Update, values: dict[str, Any]
    ) -> Iterator[ForeignRecord]:
        """Add an update's values to the open moment; another value of a path it has already opens the next one."""
        moment = open_moments[update.source]
        if any(path in moment.values and moment.values[path] != value for path, value in values.items()):
            yield ForeignRecord(moment.t_ns, moment, moment.source)
            moment = open_moments[update.source] = SourceValues(update.source, update.t_ns)
        for path, value in values.items():
            if path in moment.values:
                self.account.ignored[f"{path} once more"] += 1
            moment.values[path] = value

    def measure(self, record: ForeignRecord, t_ns: int) -> Iterator[Measurement]:
        """The measurements of one source at one moment; a value that is impossible is refused alone."""
        moment: SourceValues = record.content
        good: dict[str, Any] = {}
        for path, value in moment.values.items():
            try:
                good[path] = _checked(path, value)
            except Rejected as reason:
                self.account.rejected[f"{path} {reason}"] += 1
                continue
            self.account.taken[path] += 1
        yield from self._fixes(record, good, t_ns)
        yield from self._motions(moment.source, good, t_ns)

    def leave_out(self, record: ForeignRecord, reason: str) -> None:
        """Count the values of a record that is left out."""
        self.account.rejected[reason] += len(record.content.values)

    def sensors(self, rates_hz: dict[str, float | None]) -> tuple[SensorTable, ...]:
        """One for each source and role."""
        return self.sources.tables(PORT, rates_hz)

    def _own_values(self, update: _Update) -> dict[str, Any]:
        """Values of the paths that are read; the others are counted."""
        found: dict[str, Any] = {}
        if not update.values:
            self.account.ignored["update without values"] += 1
        for entry in update.values:
            path = entry.get("path") if isinstance(entry, dict) else None
            if not isinstance(path, str):
                self.account.rejected["value without a path"] += 1
                continue
            name = path.removeprefix(_NAVIGATION)
            if name not in PATHS or not path.startswith(_NAVIGATION):
                self.account.ignored["other path"] += 1
            elif update.source.startswith(DERIVED):
                self.account.ignored["worked out by the server"] += 1
            elif entry.get("value") is None:
                self.account.ignored[f"{name} empty"] += 1
            elif name in found:
                self.account.rejected[f"{name} twice in one update"] += 1
            else:
                found[name] = entry["value"]
        return found

    def _fixes(self, record: ForeignRecord, good: dict[str, Any], t_ns: int) -> Iterator[Measurement]:
        place, sog_kn, cog_deg = (good.get(path) for path in PATHS[:3])
        if place is None and sog_kn is None and cog_deg is None:
            return
        lat_deg, lon_deg, alt_m = place or (None, None, None)
        yield Fix(
            sensor=self.sources.id_of("gps", record.source),
            t_ns=t_ns,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_m=alt_m,
            sog_kn=sog_kn,
            cog_true_deg=cog_deg,
            utc_ns=record.t_ns,
            tod_ms=None if record.t_ns is None else record.t_ns // NS_PER_MS % DAY_MS,
        )

    def _motions(self, source: str, good: dict[str, Any], t_ns: int) -> Iterator[Measurement]:
        true_deg, mag_deg, variation_deg, turn_deg_s, attitude = (good.get(path) for path in PATHS[3:])
        if variation_deg is not None:
            self._variation_deg[source] = variation_deg
        has_heading = true_deg is not None or mag_deg is not None
        if has_heading:
            # Magnetic where there is both: the true one was made of it.
            mine = {"heading_true_deg": true_deg} if mag_deg is None else {"heading_mag_deg": mag_deg}
            if mag_deg is not None:
                mine["variation_deg"] = self._variation_deg.get(source)
            yield Heading(sensor=self.sources.id_of("compass", source), t_ns=t_ns, **mine)
        is_compass = ("compass", source) in self.sources.names
        if attitude is not None:
            roll_deg, pitch_deg, yaw_deg = attitude
            sensor = self.sources.id_of("compass" if is_compass else "imu", source)
            yield Attitude(sensor=sensor, t_ns=t_ns, roll_deg=roll_deg, pitch_deg=pitch_deg, yaw_deg=yaw_deg)
        if turn_deg_s is not None:
            sensor = self.sources.id_of("compass" if is_compass else "gyro", source)
            yield TurnRate(sensor=sensor, t_ns=t_ns, rate_deg_s=turn_deg_s)


def _closed(open_moments: dict[str, SourceValues], update: _Update) -> Iterator[ForeignRecord]:
    """The moments that are over, and those before them, in order of time."""
    over = [moment for moment in open_moments.values() if _is_over(moment, update)]
    last_ns = max((moment.t_ns for moment in over if moment.t_ns is not None), default=-1)
    earlier = [moment for moment in open_moments.values() if moment.t_ns is not None and moment.t_ns < last_ns]
    closing = {moment.source: moment for moment in (*over, *earlier)}
    for moment in sorted(closing.values(), key=lambda moment: moment.t_ns or 0):
        del open_moments[moment.source]
        yield ForeignRecord(moment.t_ns, moment, moment.source)


def _is_over(moment: SourceValues, update: _Update) -> bool:
    """True when nothing more belongs to the moment: its source gives another time, or others are ahead of it."""
    if moment.t_ns is None or update.t_ns is None:
        return moment.source == update.source
    return moment.t_ns != update.t_ns if moment.source == update.source else update.t_ns > moment.t_ns + OVER_NS


def own_contexts(lines: Iterable[str], wanted: str | None, file: str) -> tuple[str, ...]:
    """The contexts of the boat itself, its name first.

    `wanted` (context, URN or MMSI), else what a greeting calls `self`, else `vessels.self`, else the only one, else the
    only one that steers. Raises WayfixError where that leaves none or several, with the names of those there are.
    """
    said: Counter[str] = Counter()
    steered: Counter[str] = Counter()
    named = None
    for line in lines:
        content = _delta(line)[1] or {}
        if _has_values(content):
            context = _context_of(content)
            if context.startswith(NO_VESSELS) or context == NOBODY:
                continue
            said[context] += 1
            steered[context] += any(f"{_NAVIGATION}{path}" in line for path in ("heading", "rateOfTurn", "attitude"))
        elif named is None and isinstance(content.get("self"), str):
            named = f"vessels.{content['self'].removeprefix('vessels.')}"
    if not said:
        return (SELF,)
    if wanted is not None:
        fitting = [context for context in {*said, *([named, SELF] if named else [])} if _fits(context, wanted)]
    elif named or SELF in said:
        fitting = [named or SELF]
    else:
        fitting = list(said) if len(said) == 1 else list(+steered)
    if len(fitting) != 1:
        names = ", ".join(name.removeprefix("vessels.") for name, _ in said.most_common(MOST_NAMED))
        names += ", ..." if len(said) > MOST_NAMED else ""
        if wanted is None:
            what = f"has deltas of {len(said)} vessels and does not say which is the boat"
        else:
            what = f"has {'several vessels' if fitting else 'no vessel'} of the name {wanted!r}"
        raise WayfixError(what, file, f"give one with --vessel NAME: {names}")
    own = fitting[0]
    return (named, SELF) if named and own in (named, SELF) else (own,)


def _fits(context: str, wanted: str) -> bool:
    """Whether a context is the one wanted, by its whole name or the number at its end."""
    name, wanted = context.removeprefix("vessels.").lower(), wanted.strip().removeprefix("vessels.").lower()
    return name == wanted or name.endswith(f":{wanted}")


def _has_values(content: dict[str, Any]) -> bool:
    """Whether a delta has any values: one with descriptions only does not show which boat this is."""
    updates = content.get("updates")
    return isinstance(updates, list) and any(isinstance(item, dict) and item.get("values") for item in updates)


def _context_of(content: dict[str, Any]) -> str:
    """The vessel that a delta is about; without a context it is the boat itself, and what is no text is no vessel."""
    context = content.get("context") or SELF
    return context if isinstance(context, str) else NOBODY


def _updates(lines: Iterable[str], account: Account) -> Iterator[_Update]:
    for line in lines:
        stamp, content = _delta(line)
        if content is None:
            account.rejected["no JSON"] += 1
            continue
        updates = content.get("updates")
        if not isinstance(updates, list):
            account.ignored["no delta"] += 1
            continue
        if not updates:
            account.ignored["delta without updates"] += 1
        for update in updates:
            if not isinstance(update, dict):
                account.rejected["no update"] += 1
                continue
            values = update.get("values")
            values = values if isinstance(values, list) else []
            try:
                # A server's log has one clock for all sources; in bare deltas each source brings its own.
                t_ns = stamp_ns(stamp) if stamp else utc_ns_of(update.get("timestamp"), "timestamp")
            except Rejected as reason:
                account.rejected[str(reason)] += max(1, len(values))
                continue
            yield _Update(_context_of(content), _source_of(update), t_ns, values)


def _delta(line: str) -> tuple[str, dict[str, Any] | None]:
    """(time of the server's log or "", the JSON object or None)."""
    match = SERVER_LINE.match(line)
    stamp, text = (match[1], match[3]) if match else ("", line)
    if not text.lstrip().startswith("{"):
        return stamp, None
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return stamp, None
    return stamp, content if isinstance(content, dict) else None


def _source_of(update: dict[str, Any]) -> str:
    name = update.get("$source")
    if isinstance(name, str):
        return name
    source = update.get("source")
    if not isinstance(source, dict):
        return ""
    parts = (source.get(key) for key in ("label", "talker", "src"))
    return ".".join(str(part) for part in parts if isinstance(part, str | int))


def _checked(path: str, value: Any) -> Any:
    """The value in the units of our messages; raises Rejected."""
    if path == "position":
        if not isinstance(value, dict):
            raise Rejected("no position")
        lat_deg, lon_deg = number(value, "latitude", -90.0, 90.0), number(value, "longitude", -180.0, 180.0)
        if lat_deg is None or lon_deg is None:
            raise Rejected("half a position")
        return lat_deg, lon_deg, number(value, "altitude", -LARGEST, LARGEST)
    if path == "attitude":
        if not isinstance(value, dict):
            raise Rejected("no attitude")
        angles = tuple(signed_deg(value, name, DEG) for name in ("roll", "pitch", "yaw"))
        if angles == (None, None, None):
            raise Rejected("empty")
        return angles
    single = {path: value}
    if path == "speedOverGround":
        speed_m_s = number(single, path, 0.0, 1000.0 * M_S_PER_KN)
        assert speed_m_s is not None
        return speed_m_s / M_S_PER_KN
    if path == "magneticVariation":
        return signed_deg(single, path, DEG)
    if path == "rateOfTurn":
        turn = number(single, path, -4000.0 / DEG, 4000.0 / DEG)
        assert turn is not None
        return turn * DEG
    return direction_deg(single, path, DEG)
