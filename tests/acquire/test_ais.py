"""AIS sentences: checked, never altered; real captures pass whole."""

import re
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.boat_config import SensorTable
from common.messages import AisLine
from onboard.devices import Accepted, Driver, Ignored, PortDecoder, Rejected, make_driver
from onboard.reading.line_splitter import LineSplitter
from tests.acquire.sentences import MS, line, measured, recording, sealed

ONE = b"!AIVDM,1,1,,A,13RlIW?04F1beOVEFLB9bRvH0L0L,0*6C"


def driver(*talkers: str, latency_ms: float = 0.0) -> Driver:
    return make_driver(SensorTable(id="ais1", port="p", role="ais", talkers=talkers, latency_ms=latency_ms))


def ais(body: str) -> bytes:
    return b"!" + sealed(body)[1:]


def block(body: str) -> bytes:
    return b"\\" + sealed(body)[1:] + b"\\"


@pytest.mark.parametrize(
    "data",
    [
        ONE,
        b"!AIVDM,1,1,,B,,0*25",
        b"!AIVDM,1,1,1,,13aI8e?P00PGpU:NR6s00?vT2000,0,0*1C",
        ais("BSVDM,2,1,3,B,55MwgS`00001L@,0"),
        ais("ABVDO,1,1,,,15Mw,2"),
        ais("AIVDM,9,9,9,1,0Ww`,5"),
    ],
)
def test_a_sentence_is_handed_on_as_it_came(data: bytes) -> None:
    (found,) = measured(driver(latency_ms=3).feed(line(data, 8 * MS)))
    assert found == AisLine(sensor="ais1", t_ns=5 * MS, text=data.decode())


def test_parts_are_not_waited_for() -> None:
    parts = [ais("AIVDM,2,2,1,B,0000,2"), ais("AIVDM,2,1,1,B,55MwgS,0"), ais("AIVDM,2,2,1,B,0000,2")]
    one = driver()
    texts = [
        measurement.text
        for data in parts
        for measurement in measured(one.feed(line(data)))
        if hasattr(measurement, "text")
    ]
    assert texts == [data.decode() for data in parts]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (ONE[:-1] + b"D", "checksum"),
        (ONE[:-3], "no-checksum"),
        (ONE[:-3] + ONE, "run-together"),
        (ONE.replace(b"bRvH", b"b\xffvH"), "not-ascii"),
        (b"$" + ONE[1:], "start"),
        (ais("AIVDM,1,1,,A,13Rl"), "fields"),
        (ais("AIVDM,1,1,,A,13Rl,0,0,0"), "fields"),
        (ais("AIVDM,1,1,,A,13Rl,0,x"), "fields"),
        (ais("AIVDM,0,1,,A,13Rl,0"), "fields"),
        (ais("AIVDM,1,2,,A,13Rl,0"), "fields"),
        (ais("AIVDM,10,1,,A,13Rl,0"), "fields"),
        (ais("AIVDM,,1,,A,13Rl,0"), "fields"),
        (ais("AIVDM,1,1,x,A,13Rl,0"), "fields"),
        (ais("AIVDM,1,1,,AB,13Rl,0"), "fields"),
        (ais("AIVDM,1,1,,A,13Rl,6"), "fields"),
        (ais("AIVDM,1,1,,A,13Rl,"), "fields"),
        (ais("AIVDM,1,1,,A,13Xl,0"), "payload"),
        (ais("AIVDM,1,1,,A,13xl,0"), "payload"),
        (ais("AIVDM,1,1,,A,13 l,0"), "payload"),
        (ais("AIVDM,1,1,,A," + "0" * 520 + ",0"), "too-long"),
    ],
)
def test_refusals(data: bytes, reason: str) -> None:
    assert driver().claims(line(data))
    assert driver().feed(line(data)) == Rejected(reason, "ais1")


def test_a_tag_block_is_checked_and_left_out() -> None:
    tagged = block("s:r003669945,c:1120959341") + ONE
    assert driver().claims(line(tagged))
    (found,) = measured(driver().feed(line(tagged)))
    assert found == AisLine(sensor="ais1", t_ns=0, text=ONE.decode())
    broken = tagged.replace(b"c:11", b"c:12")
    assert driver().feed(line(broken)) == Rejected("tag-block", "ais1")
    assert driver().feed(line(b"\\s:x\\" + ONE)) == Rejected("tag-block", "ais1")
    assert driver().feed(line(block("c:1") + ONE[:-1] + b"D")) == Rejected("checksum", "ais1")
    assert driver().feed(line(block("s:" + "x" * 500) + ONE)) == Rejected("too-long", "ais1")


@pytest.mark.parametrize(
    ("data", "outcome"),
    [
        (sealed("AITXT,01,01,70,transceiver fault"), Ignored("TXT")),
        (sealed("AISSD,CALL,NAME,1,2,3,4,,AI"), Ignored("SSD")),
        (sealed("AIVSD,36,0,0,,,,0,0,0"), Ignored("VSD")),
        (sealed("AIALR,120000,01,V,V,x"), Ignored("ALR")),
        (sealed("PFEC,AIcmd,0,35,A"), Ignored("PFEC,AIcmd")),
        (sealed("AITXT,01,01,70,x")[:-2] + b"00", Rejected("checksum")),
    ],
)
def test_other_sentences_of_a_transponder(data: bytes, outcome: Ignored | Rejected) -> None:
    assert PortDecoder([driver()]).feed(line(data)) == outcome


def test_talkers() -> None:
    assert driver("AI").claims(line(ONE))
    assert driver("AI").claims(line(block("c:1") + ONE))
    assert not driver("BS").claims(line(ONE))


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("ais-live/pyais_nmea_data_sample.txt", {"VDM": 898}),
        ("signalk-boat-nmea/gofree-merrimac.log", {"VDM": 1507}),
        ("signalk-boat-nmea/nais300-merrimac.log", {"VDM": 417, "VDO": 132}),
        ("gpsd-receivers/ais-18-27.log", {"VDM": 276}),
        ("gpsd-receivers/ais_unpack_sixbit.log", {"VDM": 20}),
        ("gpsd-receivers/ait250.log", {"VDM": 42, "VDO": 33}),
        ("gpsd-receivers/saab-r4.log", {"VDM": 2, "VDO": 12}),
    ],
)
def test_real_captures_pass_whole_and_unaltered(name: str, parts: dict[str, int]) -> None:
    data = recording(name)
    port = PortDecoder([driver()])
    kinds: Counter[str] = Counter()
    texts: list[str] = []
    for one in LineSplitter().feed(data + b"\n", 0):
        outcome = port.feed(one)
        assert not isinstance(outcome, Rejected) or outcome.sensor is None, outcome
        if isinstance(outcome, Accepted):
            kinds[outcome.kind] += 1
            texts += [found.text for found in outcome.measurements if isinstance(found, AisLine)]
    assert kinds == parts
    assert texts == [found.decode() for found in re.findall(rb"^![A-Z]{2}VD[MO][^\r\n]*", data, re.MULTILINE)]


@given(
    st.integers(1, 9),
    st.text("0123456789:;<=>?@ABCDEFGHIJKLMNOPQRSTUVW`abcdefghijklmnopqrstuvw", max_size=60),
    st.integers(0, 5),
    st.sampled_from(["", *"0123456789"]),
    st.sampled_from(["", "A", "B", "1", "2"]),
)
def test_round_trip(parts: int, payload: str, fill: int, sequence: str, channel: str) -> None:
    data = ais(f"AIVDM,{parts},{parts},{sequence},{channel},{payload},{fill}")
    (found,) = measured(driver().feed(line(data)))
    assert found == AisLine(sensor="ais1", t_ns=0, text=data.decode())


@given(st.binary(max_size=600) | st.text("0123456789,AB\\:*!$", max_size=60).map(lambda t: ais(f"AIVDM,{t}")))
def test_arbitrary_bytes_never_raise(data: bytes) -> None:
    for candidate in (data, b"\\" + data, b"\\s:x*4B\\" + data):
        assert isinstance(driver().feed(line(candidate)), Accepted | Rejected)
        PortDecoder([driver()]).feed(line(candidate))
