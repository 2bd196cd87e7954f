"""UBX packets between NMEA sentences are passed over, whatever is in them; what only begins like one is left."""

from itertools import pairwise
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.checks import fletcher
from common.framer import Identity
from onboard.devices import Accepted, PortDecoder, make_driver
from onboard.devices.nmea_sentence import check_sentence, sentence_of
from onboard.reading import ubx_packets
from onboard.reading.acquisition import Acquisition
from onboard.reading.line_splitter import SLOWEST_LINE_NS, LineSplitter
from onboard.reading.ubx_packets import LONGEST_PAYLOAD, UbxPackets
from tests.acquire.sentences import GGA, GSA, MS, RMC, S, fixes, gps, line, measured, sealed
from tests.cases import CASES, needs_cases


def packet(kind: bytes, payload: bytes) -> bytes:
    body = kind + len(payload).to_bytes(2, "little") + payload
    first = sum(body) & 0xFF
    second = sum((len(body) - place) * byte for place, byte in enumerate(body)) & 0xFF
    return b"\xb5\x62" + body + bytes((first, second))


PACKETS = st.builds(packet, st.binary(min_size=2, max_size=2), st.binary(max_size=120))
PARTS = st.lists(st.sampled_from([GGA + b"\r\n", GSA + b"\r\n", RMC + b"\r\n"]) | PACKETS, max_size=12)


@given(PARTS, st.lists(st.integers(0, 1500), max_size=8))
def test_only_the_sentences_are_lines_whatever_the_chunks(parts: list[bytes], cuts: list[int]) -> None:
    data = b"".join(parts)
    splitter = LineSplitter()
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    found = [one.data for a, b in pairwise(edges) for one in splitter.feed(data[a:b], 0)]
    assert found == [part.rstrip() for part in parts if part.startswith(b"$")]
    assert splitter.packet_bytes == sum(len(part) for part in parts if not part.startswith(b"$"))


@given(st.lists(st.sampled_from([b"\xb5", b"\xb5\x62", b"\x01\x02", b"\x04\x00", b"$A", b"x"]), max_size=30))
def test_no_byte_is_lost_or_moved(pieces: list[bytes]) -> None:
    data, packets = b"".join(pieces), UbxPackets()
    text = b"".join(piece for at in range(len(data)) for _, piece in packets.text(data[at : at + 1], 0))
    assert packets.packets or data.startswith(text)
    assert len(text) + packets.packet_bytes + packets.held_bytes == len(data)


def test_a_damaged_length_holds_nothing_back_for_longer_than_to_the_next_sentence() -> None:
    splitter = LineSplitter()
    bad = bytearray(packet(b"\x01\x07", bytes(92)))
    bad[5] = 0x0C  # 3,164 bytes instead of 92
    assert splitter.feed(bytes(bad) + GGA + b"\r\n", 0) == []
    first, second = splitter.feed(RMC + b"\r\n", 1)
    assert sentence_of(first.data) == GGA
    assert second.data == RMC


def test_a_cut_forgets_the_packet_in_progress() -> None:
    splitter = LineSplitter()
    half = packet(b"\x01\x07", bytes(92))[:50]
    splitter.feed(half, 0)
    splitter.note_cut()
    assert splitter.discarded_bytes == len(half)
    assert [one.data for one in splitter.feed(b"\r\n" + GGA + b"\r\n", 1)] == [GGA]


HUGE = b"\xb5\x62\x01\x07\x00\x10"
"""The beginning of a packet of 4,096 bytes, which never comes."""


def test_what_begins_like_a_packet_holds_back_one_heading_of_a_compass_and_no_time_is_wrong() -> None:
    splitter, heading = LineSplitter(), b"$PTNTHPR,85.9,N,-0.9,N,0.8,N*29"
    splitter.feed(b"\r\n", 0)
    found = splitter.feed(HUGE + heading + b"\r\n", 100 * MS)
    assert splitter.complete_until(150 * MS) == 100 * MS
    for k in range(2, 6):
        found += splitter.feed(heading + b"\r\n", k * 100 * MS)
        assert len(found) == k
    assert [one.t_ns for one in found] == [k * 100 * MS for k in range(1, 6)]
    assert [one.end_ns for one in found] == [k * 100 * MS for k in range(1, 6)]


def test_what_begins_like_a_packet_and_does_not_go_on_is_given_up_after_the_time_of_a_line() -> None:
    splitter = LineSplitter()
    assert splitter.feed(HUGE + b"x\r\n", 0) == []
    assert splitter.feed(b"a slow line\r\n", 500 * MS) == []
    assert splitter.feed(b"", SLOWEST_LINE_NS) == []
    found = splitter.feed(b"", SLOWEST_LINE_NS + 1)
    assert [(one.data, one.t_ns, one.end_ns) for one in found] == [
        (HUGE + b"x", 0, 0),
        (b"a slow line", 500 * MS, 500 * MS),
    ]


def test_a_chain_gives_up_without_another_byte() -> None:
    table = PortTable(name="p", path="/dev/none")
    config = BoatConfig(boat=BoatTable(id="b"), port=(table,), sensor=(SensorTable(id="gps1", port="p", role="gps"),))
    (chain,) = Acquisition(config, Identity("b", "0" * 16, "clock", 1), 0, 0, lambda _: None).chains
    chain.changed(None, 0)
    chain.chunk(b"\r\n" + HUGE + GGA + b"\r\n", 0)
    chain.flush(SLOWEST_LINE_NS)
    assert chain.tally.lines == 0
    chain.flush(SLOWEST_LINE_NS + 1)
    assert chain.tally.accepted.total() == 1


def test_a_long_packet_within_a_burst_does_not_end_the_epoch() -> None:
    """92 bytes at 4800 baud take 0.21 s: more than the pause that ends an epoch."""
    decoder, splitter, found = PortDecoder([make_driver(gps())]), LineSplitter(), []
    data = GGA + b"\r\n" + packet(b"\x01\x07", bytes(92)) + RMC + b"\r\n"
    for at in range(len(data)):
        now_ns = at * 10 * S // 4800
        for one in splitter.feed(data[at : at + 1], now_ns):
            found += fixes(measured(decoder.feed(one)))
        found += fixes(decoder.flush(splitter.complete_until(now_ns)))
    found += fixes(decoder.flush(splitter.complete_until(now_ns + S)))
    (fix,) = found
    assert fix.sog_kn is not None


def test_hostile_bytes_are_looked_at_a_bounded_number_of_times(monkeypatch: pytest.MonkeyPatch) -> None:
    looked = 0

    def counted(data: bytes) -> int:
        nonlocal looked
        looked += len(data)
        return fletcher(data)

    monkeypatch.setattr(ubx_packets, "fletcher", counted)
    data = HUGE * 2_000
    for chunk in (1, 64, 4_096):
        looked, packets = 0, UbxPackets()
        for at in range(0, len(data), chunk):
            packets.text(data[at : at + chunk], 0)
        assert 0 < looked <= 8 * (LONGEST_PAYLOAD + 4) * (len(data) // LONGEST_PAYLOAD)


def test_a_mixed_port_shows_no_damage() -> None:
    random = Random(3)
    decoder, splitter = PortDecoder([make_driver(gps())]), LineSplitter()
    data = b"".join(packet(b"\x01\x07", random.randbytes(92)) + GGA + b"\r\n" for _ in range(200))
    outcomes = [decoder.feed(one) for one in splitter.feed(data, 0)]
    assert len(outcomes) == 200
    assert all(isinstance(outcome, Accepted) for outcome in outcomes)


@needs_cases
def test_ubx_then_sentence() -> None:
    """Its checksum is `$^`; a splitter that knows no packets has to find the sentence too."""
    data = (CASES / "board" / "ubx-then-sentence.bin").read_bytes().rstrip()
    assert isinstance(make_driver(gps()).feed(line(data)), Accepted)
    assert sentence_of(data).startswith(b"$GPGGA,")


def test_the_sentence_starts_at_the_last_dollar_that_begins_an_address() -> None:
    for before in (b"\xff$^", b"\xff$G", b"\xff$GP,", b"\xff!!", b"$\xff$"):
        assert sentence_of(before + GGA) == GGA
    assert sentence_of(b"\xb5\x62\x01" + GGA[:30] + RMC) == RMC
    own = b"$PTNTHPR,85.9,N,-0.9,N,0.8,N*29"
    assert sentence_of(b"\xff$A" + own) == own
    assert sentence_of(b"\xff$C309.8P4.0*00") == b"$C309.8P4.0*00"
    assert check_sentence(b"GA,1$" + GGA) == "not-nmea"
    assert check_sentence(GGA[:20] + sealed("GPGGA,1")) == "run-together"
