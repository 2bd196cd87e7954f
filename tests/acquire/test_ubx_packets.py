"""UBX packets between NMEA sentences are passed over, whatever is in them; what only begins like one is left."""

from itertools import pairwise
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from onboard.devices import Accepted, PortDecoder, make_driver
from onboard.devices.nmea_sentence import check_sentence, sentence_of
from onboard.reading.line_splitter import LineSplitter
from onboard.reading.ubx_packets import UbxPackets
from tests.acquire.sentences import GGA, GSA, RMC, gps, line, sealed
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
    text = b"".join(packets.text(data[at : at + 1]) for at in range(len(data)))
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
