"""Real recordings: every line is accounted for, and one Fix comes for each epoch of the receiver."""

import re
from collections import Counter
from itertools import pairwise

import pytest

from common.messages import Fix
from onboard.devices import Accepted, Ignored, Line, PortDecoder, Rejected, make_driver
from onboard.lines import LineSplitter
from tests.acquire.sentences import MS, compass, fixes, gps, recording


def play(data: bytes) -> tuple[Counter[str], list[Fix], int]:
    """Outcomes by name, the fixes, and how many lines there were."""
    decoder = PortDecoder([make_driver(gps(talkers=("GP",))), make_driver(compass())])
    counts: Counter[str] = Counter()
    found: list[Fix] = []
    lines = LineSplitter().feed(data + b"\n", 0)
    for number, one in enumerate(lines):
        outcome = decoder.feed(Line(number * MS, one.data))
        match outcome:
            case Accepted():
                counts["accepted"] += 1
                found += fixes(outcome.measurements)
            case Rejected():
                counts[f"rejected {outcome.reason}"] += 1
            case Ignored():
                counts["ignored"] += 1
    return counts, found + fixes(decoder.flush(10**18)), len(lines)


def epochs(data: bytes) -> list[str]:
    """UTC times of the GGA and RMC sentences, in order, found without the decoder."""
    times = [time.decode() for time in re.findall(rb"\$GP(?:GGA|RMC),([0-9.]+),", data)]
    return [time for before, time in pairwise(["", *times]) if time != before]


def tod_ms(time: str) -> int:
    seconds = int(time[:2]) * 3600 + int(time[2:4]) * 60
    return seconds * 1000 + round(float(time[4:]) * 1000)


@pytest.mark.parametrize(
    ("name", "rejected"),
    [
        ("gpsd-receivers/bu353s4.log", {}),
        ("serial-snippets/avalon_test_gps.txt", {}),
        # This plotter writes ZDA with a two-digit year, and `$SDVLW` sentences inside each other.
        ("signalk-boat-nmea/gofree-merrimac.log", {"rejected date": 142, "rejected run-together": 142}),
        ("gpsd-receivers/mtk-3301.log", {}),
        ("gpsd-receivers/ublox-lea-5h.log", {}),
    ],
)
def test_every_line_is_accounted_for_and_each_epoch_is_one_fix(name: str, rejected: dict[str, int]) -> None:
    data = recording(name)
    counts, found, lines = play(data)
    assert counts.total() == lines == len([one for one in re.split(rb"[\r\n]+", data) if one])
    assert {what: n for what, n in counts.items() if what.startswith("rejected")} == rejected
    timed = [fix for fix in found if fix.tod_ms is not None]
    assert [fix.tod_ms for fix in timed] == [tod_ms(time) for time in epochs(data)]
    assert not any(fix.held for fix in found)


def test_bu353_values() -> None:
    _, found, _ = play(recording("gpsd-receivers/bu353s4.log"))
    assert all(fix.usable and fix.fix_mode == 3 and fix.sog_kn is not None for fix in found)
    assert all(fix.lat_deg is not None and abs(fix.lat_deg + 37.78479) < 1e-4 for fix in found)
    # The receiver freezes its course at 181.39 below 1 kn or so.
    assert {fix.cog_true_deg for fix in found if fix.sog_kn is not None and fix.sog_kn < 1.0} == {None}


def test_cold_start_has_void_fixes_first() -> None:
    _, found, _ = play(recording("serial-snippets/avalon_test_gps.txt"))
    assert [fix.usable for fix in found] == [False] * 8 + [True] * 5
    assert all(fix.lat_deg is None and fix.utc_ns is None for fix in found[:8])


def test_a_damaged_recording_loses_nothing_silently() -> None:
    data = bytearray(recording("gpsd-receivers/bu353s4.log"))
    data[400::97] = b"\x3f" * len(data[400::97])
    counts, _, lines = play(bytes(data))
    assert counts.total() == lines
    assert counts["rejected checksum"] > 30
