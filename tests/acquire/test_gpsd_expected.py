r"""Our decoders against what gpsd says of the same bytes: `NAME.log` and `NAME.log.chk` of gpsd's `test/daemon`.

**Ours.** The log without its comment lines goes through `LineSplitter` and `PortDecoder` (receiver and compass). The
logs hold no arrival times, so line n is stamped n ms: the 150 ms flush never cuts an epoch, the UTC in the sentences
alone does, and every measurement tells its line. A log that names a delay cookie (`# Delay-Cookie: | 0.01`) has those
characters taken out, as gpsd's own player does.

**gpsd's.** The `.chk` repeats each sentence and puts the JSON objects it caused behind it; the repeated sentence,
looked up in the log, gives the object a line. The time of day of a TPV is its `time`, else that of the last sentence
with a time, read here with one regular expression. TPVs that follow each other with the same time of day are one epoch,
and the last one counts. A time of day that comes again later is another epoch (time runs backwards in one log).

**Matching.** A TPV with `time` is compared with our Fix of that time of day whose line is nearest, one without (gpsd
has no date yet) with our Fix whose sentences hold the line. gpsd repeats a fix that has ended under its old time behind
the first sentence of the next epoch, which is why lines alone are not enough.

- `position`: both angles within 1e-6 degree, wherever the TPV has a position.
- `time`: a Fix of that time of day (1 ms) exists, wherever the TPV has a time.
- `void`: where gpsd says mode 1 (no fix), ours is not usable; a position kept under status V is not one.
- `date`: UTC day of our Fix, where a sentence since the epoch before carries it (RMC status A, ZDA). gpsd moves some
  dates by whole 1024 weeks into what it takes for the present; we keep the receiver's. Such a date agrees.
- `heading`, `pitch`, `roll` within 0.1 degree, `turn` within 0.1 degree/min: our newest value at the line of the last
  ATT of an epoch; without any time every ATT counts. Each is compared only where gpsd has it.

A capture put into the same folder is compared too; what differs must be in the table below.
"""

import json
import re
from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from common.framer import Measurement
from common.messages import Attitude, Fix, Heading, TurnRate
from common.units import NS_PER_S
from onboard.devices import Accepted, Line, PortDecoder, make_driver
from onboard.reading.line_splitter import LineSplitter
from tests.acquire.sentences import MS, compass, gps, sealed
from tests.recordings import SHARED_DATA

FOLDER = SHARED_DATA / "gpsd-receivers"
SHARE = 0.95
DAY_MS = 86_400_000

NOTHING_TO_COMPARE = {"ais-18-27", "ais_unpack_sixbit", "passthrough"}
REFUSED = "tnt-revolution"
LEAST_COMPARED = {"position": 500, "time": 400, "date": 400, "heading": 30, "turn": 30, "pitch": 20, "roll": 20}

_AC12 = "its ZDA runs 2 s ahead, and at the end of the log no fix of that time comes any more"
_LEA_START = "the log opens with the ZDA of an epoch before the first fix; ZDA alone makes none"
_UBX = "UBX binary, not NMEA: nothing is decoded (what gpsd echoes are sentences of its own making)"

DIFFERENCES: dict[tuple[str, str], tuple[int, str]] = {
    ("ac12", "time"): (1, _AC12),
    ("ac12", "date"): (1, _AC12),
    ("april6_2019", "position"): (
        1,
        "a receiver after its week rollover writes the date 2208-1: the sentence is refused",
    ),
    ("ublox-lea-4h", "time"): (1, _LEA_START),
    ("ublox-lea-4h", "date"): (1, _LEA_START),
    ("ublox-lea-4h", "void"): (1, "gpsd tells the loss of the fix under the time of the last good epoch"),
    ("ublox-neo-m8n", "position"): (22, _UBX),
    ("ublox-neo-m8n", "time"): (22, _UBX),
}
"""(log, quantity) -> how many epochs differ, and why."""

_CLOCK = re.compile(rb"[$]..(?:(?:GGA|GNS|RMC|ZDA),(\d{6}[.\d]*)|GLL,[^,]*,[^,]*,[^,]*,[^,]*,(\d{6}[.\d]*))")
_DATED = re.compile(rb"[$]..(?:RMC,(\d{6}[.\d]*),A,(?:[^,]*,){6}\d{6},|ZDA,(\d{6}[.\d]*),\d\d,\d\d,\d)")


@dataclass
class Ours:
    """What our decoders made of a log; line numbers from 0."""

    lines: list[bytes]
    fixes: list[Fix] = field(default_factory=list)
    values: dict[str, list[tuple[int, float]]] = field(default_factory=dict)
    """Heading, pitch, roll in degrees, turn in degrees/min (+ to starboard), each with its line."""

    def at(self, number: int) -> Fix | None:
        """The Fix whose sentences hold that line."""
        place = bisect_right(self.fixes, number * MS, key=lambda fix: fix.t_ns)
        return self.fixes[place - 1] if place else None

    def of_time(self, tod_ms: int, number: int) -> Fix | None:
        """The Fix of that time of day, within 1 ms; of several the nearest one."""
        found = [fix for fix in self.fixes if fix.tod_ms is not None and abs(fix.tod_ms - tod_ms) <= 1]
        return min(found, key=lambda fix: abs(fix.t_ns - number * MS), default=None)

    def newest(self, name: str, number: int) -> float | None:
        known = self.values.get(name, [])
        place = bisect_right(known, (number, float("inf")))
        return known[place - 1][1] if place else None


@dataclass(frozen=True)
class Report:
    """One object of gpsd's, the last of its epoch."""

    number: int
    """The line behind which it stands."""
    tod_ms: int | None
    json: dict[str, Any]


def device_bytes(log: bytes) -> bytes:
    """What the device sent: comments and delay cookies are gpsd's."""
    lines = log.splitlines(keepends=True)
    data = b"".join(one for one in lines if not one.startswith(b"#"))
    cookie = re.search(rb"^# Delay-Cookie: (\S)", log, re.MULTILINE)
    return data if cookie is None else data.replace(cookie[1], b"")


def decode(data: bytes) -> Ours:
    decoder = PortDecoder([make_driver(gps()), make_driver(compass())])
    lines = LineSplitter().feed(data + b"\n", 0)
    ours = Ours([line.data for line in lines])
    for number, line in enumerate(ours.lines):
        outcome = decoder.feed(Line(number * MS, line))
        take(ours, number, outcome.measurements if isinstance(outcome, Accepted) else ())
    take(ours, len(lines), decoder.flush(10**18))
    return ours


def take(ours: Ours, number: int, measurements: tuple[Measurement, ...]) -> None:
    for one in measurements:
        found: dict[str, float | None] = {}
        if isinstance(one, Fix):
            ours.fixes.append(one)
        elif isinstance(one, Heading):
            heading = one.heading_mag_deg if one.heading_true_deg is None else one.heading_true_deg
            found = {"heading": heading, "pitch": one.pitch_deg, "roll": one.roll_deg}
        elif isinstance(one, Attitude):
            found = {"pitch": one.pitch_deg, "roll": one.roll_deg}
        elif isinstance(one, TurnRate):
            found = {"turn": one.rate_deg_s * 60.0}
        for name, value in found.items():
            if value is not None:
                ours.values.setdefault(name, []).append((number, value))


def tod_ms(text: str) -> int:
    """`hhmmss[.sss]`, read apart from the decoders."""
    return (int(text[:2]) * 3600 + int(text[2:4]) * 60) * 1000 + round(float(text[4:]) * 1000)


def clock_of(pattern: re.Pattern[bytes], line: bytes) -> int | None:
    match = pattern.match(line)
    return None if match is None else tod_ms((match[1] or match[2]).decode())


def reports(check: bytes, lines: list[bytes], kind: str) -> list[Report]:
    """The last object of that class of each epoch, in gpsd's order."""
    where: dict[bytes, list[int]] = {}
    for number, line in enumerate(lines):
        where.setdefault(line, []).append(number)
    number, clock, found = -1, None, list[Report]()
    for line in check.splitlines():
        if not line.startswith(b'{"class":'):
            places = where.get(line.strip(), [])
            next_one = bisect_right(places, number)
            number = places[next_one] if next_one < len(places) else number
            clock = clock if (heard := clock_of(_CLOCK, line)) is None else heard
            continue
        content = json.loads(line)
        if content["class"] != kind:
            continue
        time = content.get("time")
        key = tod_ms(time[11:-1].replace(":", "")) if time else clock
        # A compass alone sends no time at all: there every object is an epoch of its own.
        if found and found[-1].tod_ms == key and (key is not None or kind == "TPV"):
            found.pop()
        found.append(Report(number, key, content))
    return found


@dataclass
class Tally:
    """Counts of one or more logs, by quantity."""

    compared: Counter[str] = field(default_factory=Counter)
    agreed: Counter[str] = field(default_factory=Counter)

    def note(self, quantity: str, *, good: bool) -> None:
        self.compared[quantity] += 1
        self.agreed[quantity] += good

    def differing(self) -> dict[str, int]:
        return {name: n - self.agreed[name] for name, n in self.compared.items() if n > self.agreed[name]}


def compare_epoch(tally: Tally, ours: Ours, dated: set[int | None], report: Report) -> None:
    """One TPV with our Fix of the epoch; `dated`: times of day that have come with a date since the epoch before."""
    tpv, time, number = report.json, report.json.get("time"), report.number
    fix = ours.at(number) if time is None or report.tod_ms is None else ours.of_time(report.tod_ms, number)
    if time is not None:
        tally.note("time", good=fix is not None)
    if "lat" in tpv and "lon" in tpv:
        tally.note("position", good=fix is not None and same_place(fix, tpv["lat"], tpv["lon"]))
    elif tpv["mode"] == 1:
        tally.note("void", good=fix is None or not fix.usable)
    if time is not None and report.tod_ms in dated:
        tally.note("date", good=fix is not None and same_day(fix, date.fromisoformat(time[:10])))


def same_place(fix: Fix, lat_deg: float, lon_deg: float) -> bool:
    if fix.lat_deg is None or fix.lon_deg is None:
        return False
    return abs(fix.lat_deg - lat_deg) <= 1e-6 and abs(fix.lon_deg - lon_deg) <= 1e-6


def same_day(fix: Fix, day: date) -> bool:
    if fix.utc_ns is None:
        return False
    return (day - datetime.fromtimestamp(fix.utc_ns // NS_PER_S, UTC).date()).days % (1024 * 7) == 0


def compare_attitude(tally: Tally, ours: Ours, report: Report) -> None:
    """One ATT with our newest values; gpsd calls a magnetic heading `mheading`."""
    att = report.json
    expected = {"heading": att.get("heading", att.get("mheading")), "pitch": att.get("pitch")}
    expected |= {"roll": att.get("roll"), "turn": att.get("rot")}
    for name, wanted in expected.items():
        if wanted is not None:
            value = ours.newest(name, report.number)
            turn = None if value is None else abs((value - wanted + 180.0) % 360.0 - 180.0)
            tally.note(name, good=turn is not None and turn <= 0.1)


@cache
def compared(path: Path) -> Tally:
    """One log with its `.chk`."""
    tally, ours = Tally(), decode(device_bytes(path.read_bytes()))
    check = path.with_name(path.name + ".chk").read_bytes()
    dated = [clock_of(_DATED, line) for line in ours.lines]
    before = -1
    for report in reports(check, ours.lines, "TPV"):
        compare_epoch(tally, ours, set(dated[before + 1 : report.number + 1]), report)
        before = report.number
    for report in reports(check, ours.lines, "ATT"):
        compare_attitude(tally, ours, report)
    return tally


def logs() -> list[Path]:
    if not FOLDER.is_dir():
        pytest.skip(f"gpsd's captures are not beside the repository ({FOLDER})")
    return sorted(path for path in FOLDER.glob("*.log") if path.with_name(path.name + ".chk").exists())


def test_every_difference_is_in_the_table() -> None:
    found = {
        (path.stem, quantity): count
        for path in logs()
        if path.stem != REFUSED
        for quantity, count in compared(path).differing().items()
    }
    assert found == {where: count for where, (count, _) in DIFFERENCES.items()}


def test_each_quantity_agrees_to_95_percent() -> None:
    epochs, agreed = Counter[str](), Counter[str]()
    for path in logs():
        if path.stem != REFUSED:
            epochs += compared(path).compared
            agreed += compared(path).agreed
    assert {name: round(agreed[name] / n, 4) for name, n in epochs.items() if agreed[name] < SHARE * n} == {}
    # Far fewer than these, and the matching has lost the epochs, not the decoder.
    assert all(epochs[name] >= least for name, least in LEAST_COMPARED.items()), epochs


def test_logs_with_nothing_to_compare_stay_so() -> None:
    empty = {path.stem for path in logs() if not compared(path).compared}
    assert empty == NOTHING_TO_COMPARE


def test_a_compass_out_of_range_is_refused() -> None:
    """`PTNTHTM` with a heading of 14223 and a pitch of 169: counts, not degrees; gpsd hands them on."""
    (path,) = [path for path in logs() if path.stem == REFUSED]
    ours = decode(device_bytes(path.read_bytes()))
    assert len(ours.lines) > 50
    assert (ours.fixes, ours.values) == ([], {})


def test_binary_is_survived_and_nothing_is_read_from_it() -> None:
    (path,) = [path for path in logs() if path.stem == "ublox-neo-m8n"]
    data = device_bytes(path.read_bytes())
    ours = decode(data)
    assert (ours.fixes, ours.values) == ([], {})
    assert sum(map(len, ours.lines)) < 0.01 * len(data)  # the splitter takes out whole packets
    decoder = PortDecoder([make_driver(gps()), make_driver(compass())])
    pieces = [Line(0, piece) for piece in re.split(rb"[\r\n]+", data)]
    assert len(pieces) > 50
    assert not any(isinstance(decoder.feed(piece), Accepted) for piece in pieces)


def test_no_epoch_makes_two_fixes() -> None:
    for path in logs():
        times = [fix.tod_ms for fix in decode(device_bytes(path.read_bytes())).fixes]
        assert all(one is None or one != after for one, after in pairwise(times)), path.stem


def test_matching_by_time_where_gpsd_repeats_an_old_fix_behind_the_next_sentence() -> None:
    first, second = sealed("GPGLL,4900.0000,N,12200.0000,W,030858,A,A"), sealed("GPGLL,,,,,030900,V,N")
    log = b"\n".join([first, second, b""])
    old = b'{"class":"TPV","mode":1,"time":"2006-08-10T03:08:58.000Z"}'
    check = b"\n".join([first, old.replace(b"1,", b'2,"lat":49.0,"lon":-122.0,', 1), second, old])
    (report,) = reports(check, decode(log).lines, "TPV")
    assert (report.number, report.tod_ms, report.json["mode"]) == (1, 11_338_000, 1)
    fix = decode(log).of_time(11_338_000, 1)
    assert fix is not None
    assert same_place(fix, 49.0, -122.0)
