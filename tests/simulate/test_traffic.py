"""Ships around the boat: AIS and radar see the same ones, and the sentences hold what was put in."""

import math
import re
from collections import defaultdict
from functools import reduce

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.simulation.ais_sentences import Report, position_a, position_b, static_a
from common.simulation.readings import AisReading, RadarReading
from common.simulation.scenarios import find_world
from common.simulation.traffic import OWN_MMSI, SHIPS
from common.simulation.voyage import Voyage, boat_voyage

SENTENCE = re.compile(r"!(AIVDM|AIVDO),([1-9]),([1-9]),([0-9]?),([AB]?),([0-9:;<=>?@A-W`a-w]+),([0-5])\*([0-9A-F]{2})")
BOAT = BoatConfig(
    boat=BoatTable(id="b", variation_deg=0.0),
    port=(PortTable(name="a", path="a"),),
    sensor=(SensorTable(id="ais1", port="a", role="ais"), SensorTable(id="radar1", port="a", role="radar")),
)


def bits_of(sentences: tuple[str, ...]) -> str:
    """Bits of a message, fill bits removed; checks form, checksum and the count of parts."""
    found = ""
    for number, sentence in enumerate(sentences, start=1):
        match = SENTENCE.fullmatch(sentence)
        assert match, sentence
        assert len(sentence) <= 80
        assert (int(match[2]), int(match[3])) == (len(sentences), number)
        assert reduce(lambda a, b: a ^ b, sentence[1:-3].encode()) == int(match[8], 16)
        for letter in match[6]:
            value = ord(letter) - 48
            found += format(value - 8 if value > 40 else value, "06b")
        if match[7] != "0":
            found = found[: -int(match[7])]
    return found


def signed(bits: str) -> int:
    return int(bits, 2) - (1 << len(bits)) * int(bits[0])


def text(bits: str) -> str:
    values = [int(bits[at : at + 6], 2) for at in range(0, len(bits), 6)]
    return "".join(chr(value + 64 if value < 32 else value) for value in values).rstrip("@ ")


def position(bits: str) -> Report:
    """Fields of message 1 or 18 as ITU-R M.1371 places them."""
    at = {1: 50, 18: 46}[int(bits[:6], 2)]
    assert len(bits) == 168
    heading = int(bits[at + 78 : at + 87], 2)
    return Report(
        mmsi=int(bits[8:38], 2),
        sog_m_s=int(bits[at : at + 10], 2) / 10.0 * 1852.0 / 3600.0,
        lon_deg=signed(bits[at + 11 : at + 39]) / 600_000.0,
        lat_deg=signed(bits[at + 39 : at + 66]) / 600_000.0,
        cog_true_deg=int(bits[at + 66 : at + 78], 2) / 10.0,
        heading_true_deg=None if heading == 511 else heading,
    )


@given(
    st.builds(
        Report,
        mmsi=st.integers(1, 999_999_999),
        lat_deg=st.floats(-90.0, 90.0),
        lon_deg=st.floats(-180.0, 180.0),
        sog_m_s=st.floats(0.0, 50.0),
        cog_true_deg=st.floats(0.0, 359.94),
        heading_true_deg=st.none() | st.floats(0.0, 359.4),
    ),
    st.booleans(),
)
def test_a_position_report_holds_what_was_put_in(report: Report, is_class_b: bool) -> None:
    read = position(bits_of(position_b(report) if is_class_b else position_a(report)))
    assert read.mmsi == report.mmsi
    assert read.lat_deg == pytest.approx(report.lat_deg, abs=1e-6)
    assert read.lon_deg == pytest.approx(report.lon_deg, abs=1e-6)
    assert read.sog_m_s == pytest.approx(report.sog_m_s, abs=0.03)
    assert read.cog_true_deg == pytest.approx(report.cog_true_deg, abs=0.051)
    if report.heading_true_deg is None or read.heading_true_deg is None:
        assert read.heading_true_deg is report.heading_true_deg is None
    else:
        assert read.heading_true_deg == pytest.approx(report.heading_true_deg, abs=0.51)


def test_static_data_of_two_sentences() -> None:
    sentences = static_a(235_100_001, "VIRTUAL 2", 7)
    assert len(sentences) == 2
    bits = bits_of(sentences)
    assert len(bits) == 424
    assert (int(bits[:6], 2), int(bits[8:38], 2), text(bits[112:232])) == (5, 235_100_001, "VIRTUAL 2")
    assert int(bits[240:249], 2) + int(bits[249:258], 2) == 90


@pytest.fixture(scope="module")
def voyage() -> Voyage:
    return boat_voyage(find_world("real-coast"), BOAT, seed=2, seconds=400.0)


def test_radar_and_ais_see_the_same_ships(voyage: Voyage) -> None:
    """What the tracker measures is where the ship's own report says it is, within plot noise and digits."""
    reports = defaultdict(list)
    for timed in voyage.readings:
        if isinstance(timed.reading, AisReading) and ",1,1,," in timed.reading.sentence:
            report = position(bits_of((timed.reading.sentence,)))
            reports[report.mmsi].append((timed.t_s, *voyage.plane.to_east_north_m(report.lat_deg, report.lon_deg)))
    assert len(reports.pop(OWN_MMSI)) >= 39
    assert len(reports) == SHIPS
    seen = set()
    for timed in voyage.readings:
        if isinstance(timed.reading, RadarReading) and timed.reading.status == "tracking":
            target, own = timed.reading, voyage.truth.at(np.array([timed.t_s]))
            bearing = math.radians(target.bearing_true_deg or 0.0)
            place = np.array([own.east_m[0], own.north_m[0]])
            place += (target.range_m or 0.0) * np.array([math.sin(bearing), math.cos(bearing)])
            track = np.array(reports[235_100_000 + target.number - 1])
            there = [np.interp(timed.t_s, track[:, 0], track[:, axis]) for axis in (1, 2)]
            if track[0, 0] <= timed.t_s <= track[-1, 0]:
                assert (
                    np.hypot(*(place - there))
                    < 5.0 * math.hypot(15.0, math.radians(0.5) * (target.range_m or 0.0)) + 25.0
                )
                seen.add(target.number)
    assert len(seen) >= 3


def test_reports_come_as_often_as_the_rules_say(voyage: Voyage) -> None:
    """Ten seconds for a slow ship of class A, six for a fast one, thirty for class B."""
    times = defaultdict(list)
    for timed in voyage.readings:
        if isinstance(timed.reading, AisReading) and ",1,1,," in timed.reading.sentence:
            times[int(bits_of((timed.reading.sentence,))[8:38], 2)].append(timed.t_s)
    for mmsi, stamps in times.items():
        gaps = np.unique(np.round(np.diff(stamps), 6))
        assert len(gaps) == 1
        assert gaps[0] in ((10.0,) if mmsi == OWN_MMSI else (6.0, 10.0, 30.0))
