"""Real recordings: every line is accounted for, by kind, and one Fix comes for each epoch of the receiver.

What is expected is counted here from the text, without the decoders; only the ports' sensors (receiver and compass) are
configured, so AIS, radar and the boat's other instruments are ignored lines.
"""

import csv
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import reduce
from itertools import pairwise
from operator import xor

import pytest

from common.messages import Fix
from onboard.devices import Accepted, Ignored, Line, PortDecoder, Rejected, make_driver
from onboard.devices.gps.driver import ASIDE
from onboard.reading.line_splitter import LineSplitter
from tests.acquire.sentences import MS, compass, fixes, gps, recording, sealed

RECEIVER = ("GGA", "GNS", "RMC", "GLL", "VTG", "GSA", "ZDA")
HEADINGS = ("HDG", "HDM", "HDT")
GOFREE = ("GP", "SD")
"""Chart plotters of this maker: receiver GP, compass SD."""


@dataclass
class Played:
    """What became of a recording."""

    lines: list[bytes]
    counts: Counter[str] = field(default_factory=Counter)
    """`accepted GGA`, `rejected checksum`, `ignored VDM`."""
    fixes: list[Fix] = field(default_factory=list)


def play(data: bytes, receiver: str = "GP", heading: str = "HC") -> Played:
    """`receiver`, `heading`: talkers of the two sensors, empty = all."""
    tables = gps(talkers=(receiver,) if receiver else ()), compass(talkers=(heading,) if heading else ())
    decoder = PortDecoder([make_driver(table) for table in tables])
    played = Played([one.data for one in LineSplitter().feed(data + b"\n", 0)])
    for number, line in enumerate(played.lines):
        match decoder.feed(Line(number * MS, line)):
            case Accepted(kind=kind, measurements=measurements):
                played.counts[f"accepted {kind}"] += 1
                played.fixes += fixes(measurements)
            case Rejected(reason=reason):
                played.counts[f"rejected {reason}"] += 1
            case Ignored(kind=kind):
                played.counts[f"ignored {kind}"] += 1
    played.fixes += fixes(decoder.flush(10**18))
    return played


def counted(lines: list[bytes], receiver: str, heading: str) -> Counter[str]:
    """Accepted and ignored sentences as the text has them: right checksum, address, talker, a heading that is there."""
    counts = Counter[str]()
    for line in lines:
        match = re.fullmatch(rb"[$!](([A-Z0-9]{2})([A-Z]{3})[,][^$!*]*)[*]([0-9A-F]{2})", line)
        if match is None or reduce(xor, match[1], 0) != int(match[4], 16):
            continue
        talker, formatter = match[2].decode(), match[3].decode()
        ours = formatter in RECEIVER and talker in (receiver or talker)
        if formatter in HEADINGS and talker in (heading or talker):
            if not match[1].split(b",")[1]:
                continue
            ours = True
        counts[f"{'accepted' if ours else 'ignored'} {formatter}"] += 1
    return counts


def epochs(lines: list[bytes], receiver: str) -> list[int]:
    """Times of day in ms of the positions, in order, found without the decoder."""
    pattern = re.compile(
        rb"[$]%b(?:(?:GGA|GNS|RMC),|GLL,(?:[^,]*,){4})(\d{6}[.\d]*),.*[*]" % (receiver.encode() or b"..")
    )
    times = [tod_ms(match[1].decode()) for line in lines if (match := pattern.match(line))]
    return [time for before, time in pairwise([-1, *times]) if time != before]


def tod_ms(time: str) -> int:
    seconds = int(time[:2]) * 3600 + int(time[2:4]) * 60
    return seconds * 1000 + round(float(time[4:]) * 1000)


def stream(name: str) -> bytes:
    """What the port carried; a table of a ROS bag has the sentence in its last column."""
    data = recording(name)
    if not name.endswith(".csv"):
        return data
    return "\n".join(row["sentence"] for row in csv.DictReader(data.decode().splitlines())).encode()


@pytest.mark.parametrize(
    ("name", "talkers", "rejected"),
    [
        ("gpsd-receivers/bu353s4.log", ("GP", "HC"), {}),
        ("serial-snippets/avalon_test_gps.txt", ("GP", "HC"), {}),
        # This plotter writes `$SDVLW` sentences inside each other.
        ("signalk-boat-nmea/gofree-merrimac.log", GOFREE, {"run-together": 142}),
        ("signalk-boat-nmea/n2kd-183-merrimac.log", ("", "04"), {}),
        # Its compass sentences, HDT twice and HDM once in two seconds, are all empty.
        ("signalk-boat-nmea/plaka.log", ("", "II"), {"empty": 1500}),
        ("radar-ttm-nmea/RadarLogs_lines_1-2000.txt", GOFREE, {}),
        ("radar-ttm-nmea/RadarLogs_lines_20001-40000.txt", GOFREE, {}),
        ("milliampere-ferry/maneuvering1_GPGGA.csv", ("GP", ""), {}),
        # The first line is the end of a sentence, in one file the last line is a beginning.
        ("ocean-rtk-usv/202412051556.txt", ("", ""), {"not-nmea": 1}),
        ("ocean-rtk-usv/202412051741.txt", ("", ""), {"not-nmea": 1, "no-checksum": 1}),
        ("ocean-rtk-usv/202412051751.txt", ("", ""), {}),
        ("ocean-rtk-usv/202412061552.txt", ("", ""), {"not-nmea": 1}),
        ("ocean-rtk-usv/202412071309.txt", ("", ""), {"not-nmea": 1}),
        ("sailing-nmea/irene_20130911_NMEA0001.TXT", ("II", "II"), {}),
        ("sailing-nmea/psaros33_20140821_NMEA0010.TXT", ("II", "II"), {}),
        ("gpsd-receivers/mtk-3301.log", ("GP", "HC"), {}),
        ("gpsd-receivers/sirfstarv-nmea.log", ("", "HC"), {}),
        ("gpsd-receivers/beidou-bd.log", ("", "HC"), {"not-nmea": 1}),
        ("gpsd-receivers/ublox-lea-5h.log", ("GP", "HC"), {}),
    ],
)
def test_every_line_is_accounted_for_and_each_epoch_is_one_fix(
    name: str, talkers: tuple[str, str], rejected: dict[str, int]
) -> None:
    data = stream(name)
    played = play(data, *talkers)
    assert played.counts.total() == len(played.lines) == len([one for one in re.split(rb"[\r\n]+", data) if one])
    aside = sum(n for what, n in played.counts.items() if what.endswith(ASIDE))
    assert aside <= 1  # a GLL that leads its first burst, or one behind the epoch before
    played.counts = Counter(what.removesuffix(f" {ASIDE}") for what in played.counts.elements())
    found = {what: n for what, n in played.counts.items() if not re.fullmatch("ignored (text|P.*)", what)}
    expected = counted(played.lines, *talkers)
    expected += Counter({f"rejected {reason}": n for reason, n in rejected.items()})
    assert found == expected
    timed = [fix for fix in played.fixes if fix.tod_ms is not None]
    assert [fix.tod_ms for fix in timed] == epochs(played.lines, talkers[0])
    assert not any(fix.held for fix in played.fixes)


def newer(line: bytes) -> bytes:
    """The sentence as NMEA 4.11 has it: GN, the navigational status behind RMC, the system behind GSA."""
    body = line[1:-3].decode()
    more = {"RMC": ",V", "GSA": ",1"}.get(body[2:5], "")
    return sealed(f"GN{body[2:]}{more}") if body[2:5] in RECEIVER else line


@pytest.mark.parametrize("name", ["gpsd-receivers/bu353s4.log", "gpsd-receivers/ublox-lea-5h.log"])
@pytest.mark.parametrize(
    "dress",
    [
        lambda line: line + b"\r",
        lambda line: line + b"\r\r\n",
        lambda line: b"\\s:GP0001,c:1326055296*3C\\" + line + b"\n",
        lambda line: b"\x00\xff" + line + b"\n",
        lambda line: newer(line) + b"\n",
    ],
    ids=["CR", "CR CR LF", "tag block", "noise", "NMEA 4.11"],
)
def test_the_same_receiver_in_another_dress(name: str, dress: Callable[[bytes], bytes]) -> None:
    sentences = [line for line in recording(name).splitlines() if line.startswith(b"$")]
    plain, dressed = play(b"\n".join(sentences), ""), play(b"".join(map(dress, sentences)), "")
    assert dressed.fixes == plain.fixes
    assert dressed.counts == plain.counts


def test_binary_packets_between_the_sentences_cost_none_of_them() -> None:
    """u-blox receivers mix UBX and NMEA on a port; a packet has no line end of its own."""
    packets = recording("gpsd-receivers/ublox-neo-m8n.log").split(b"\xb5\x62")[1:]
    data = recording("gpsd-receivers/ublox-lea-5h.log")
    mixed = [b"\xb5\x62" + packets[n % len(packets)] + line for n, line in enumerate(data.splitlines(keepends=True))]
    whole, among = play(data), play(b"".join(mixed))
    assert [(fix.tod_ms, fix.lat_deg, fix.sog_kn) for fix in among.fixes] == [
        (fix.tod_ms, fix.lat_deg, fix.sog_kn) for fix in whole.fixes
    ]


def test_a_gateways_two_digit_years_are_years_of_this_century() -> None:
    """The plotter writes `16,04,14`; ZDA and RMC of one second agree."""
    data = stream("signalk-boat-nmea/gofree-merrimac.log")
    without_rmc = b"\n".join(line for line in data.splitlines() if not line.startswith(b"$GPRMC"))
    days = [[fix.utc_ns for fix in play(one, "GP", "SD").fixes] for one in (data, without_rmc)]
    assert len(days[0]) == 142
    assert None not in days[0]
    assert days[0] == days[1]


def test_bu353_values() -> None:
    found = play(recording("gpsd-receivers/bu353s4.log")).fixes
    assert all(fix.usable and fix.fix_mode == 3 and fix.sog_kn is not None for fix in found)
    assert all(fix.lat_deg is not None and abs(fix.lat_deg + 37.78479) < 1e-4 for fix in found)
    # The receiver freezes its course at 181.39 below 1 kn or so.
    assert {fix.cog_true_deg for fix in found if fix.sog_kn is not None and fix.sog_kn < 1.0} == {None}


def test_cold_start_has_void_fixes_first() -> None:
    found = play(recording("serial-snippets/avalon_test_gps.txt")).fixes
    assert [fix.usable for fix in found] == [False] * 8 + [True] * 5
    assert all(fix.lat_deg is None and fix.utc_ns is None for fix in found[:8])


def test_a_damaged_recording_loses_nothing_silently() -> None:
    data = bytearray(recording("gpsd-receivers/bu353s4.log"))
    data[400::97] = b"\x3f" * len(data[400::97])
    played = play(bytes(data))
    assert played.counts.total() == len(played.lines)
    assert played.counts["rejected checksum"] > 30
