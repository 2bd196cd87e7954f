"""The splitter: any chunking gives the same lines, every byte is accounted for, memory is bounded."""

import re
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.reading.line_splitter import LONGEST_LINE, SLOWEST_LINE_NS, LineSplitter

streams = st.lists(
    st.sampled_from([b"\r", b"\n", b"\r\n", b"$GP", b"x", b"\xff", b"a" * 200, b"b" * 513]), max_size=30
).map(b"".join)


def whole_lines(data: bytes) -> list[bytes]:
    """What must come out, found without the splitter."""
    *whole, _ = re.split(rb"[\r\n]", data)
    return [piece for piece in whole if 0 < len(piece) <= LONGEST_LINE]


@given(streams, st.lists(st.integers(0, 700), max_size=8))
def test_any_chunking_gives_the_same_lines_and_loses_no_byte(data: bytes, cuts: list[int]) -> None:
    splitter = LineSplitter()
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    lines = [found for a, b in pairwise(edges) for found in splitter.feed(data[a:b], t_ns=1000 * a)]
    assert [found.data for found in lines] == whole_lines(data)
    ends = data.count(b"\r") + data.count(b"\n")
    in_lines = sum(len(found.data) for found in lines)
    assert in_lines + ends + splitter.discarded_bytes + splitter.pending_bytes == len(data)
    assert splitter.pending_bytes <= LONGEST_LINE
    assert splitter.lines == len(lines)


@given(streams, st.integers(0, 700), st.booleans())
def test_bytes_are_conserved_over_a_cut(data: bytes, at: int, reopened: bool) -> None:
    splitter = LineSplitter()
    at = min(at, len(data))
    lines = splitter.feed(data[:at], 1)
    if reopened:
        splitter.reset()
    else:
        splitter.note_cut()
    lines += splitter.feed(data[at:], 2)
    ends = data.count(b"\r") + data.count(b"\n")
    in_lines = sum(len(found.data) for found in lines)
    assert in_lines + ends + splitter.discarded_bytes + splitter.pending_bytes == len(data)


def test_time_is_that_of_the_chunk_with_the_first_byte_and_the_end_is_kept() -> None:
    splitter = LineSplitter()
    assert splitter.feed(b"\r\n$A", 10) == []
    assert splitter.feed(b"BC", 20) == []
    first, second = splitter.feed(b"D\r\n$E\r$F", 30)
    assert (first.data, first.t_ns, first.end_ns) == (b"$ABCD", 10, 30)
    assert (second.data, second.t_ns, second.end_ns) == (b"$E", 30, 30)
    (third,) = splitter.feed(b"\r", 40)
    assert (third.data, third.t_ns, third.end_ns) == (b"$F", 30, 40)


@pytest.mark.parametrize(("length", "passes"), [(LONGEST_LINE, True), (LONGEST_LINE + 1, False)])
def test_length_limit(length: int, passes: bool) -> None:
    splitter = LineSplitter()
    lines = splitter.feed(b"a" * length + b"\nok\n", 0)
    assert [found.data for found in lines] == ([b"a" * length] if passes else []) + [b"ok"]
    assert splitter.overflows == (0 if passes else 1)
    assert splitter.discarded_bytes == (0 if passes else length)


def test_endless_line_holds_no_memory_and_counts_once() -> None:
    splitter = LineSplitter()
    for _ in range(100):
        assert splitter.feed(b"z" * 1000, 0) == []
    assert splitter.pending_bytes <= LONGEST_LINE
    assert splitter.overflows == 1
    assert [found.data for found in splitter.feed(b"\ngood\n", 0)] == [b"good"]


def test_after_a_cut_the_rest_of_the_line_is_dropped() -> None:
    splitter = LineSplitter()
    splitter.feed(b"$GPGGA,12", 0)
    splitter.note_cut()
    assert [found.data for found in splitter.feed(b"$45,N*00\r\n$ok\r\n", 0)] == [b"$ok"]
    assert splitter.discarded_bytes == len(b"$GPGGA,12" + b"$45,N*00")


def test_a_reopened_port_keeps_a_sentence_that_starts_it_and_drops_a_tail() -> None:
    splitter = LineSplitter()
    splitter.reset()
    assert splitter.feed(b"", 0) == []
    assert [found.data for found in splitter.feed(b"$whole\r\n", 0)] == [b"$whole"]
    splitter.reset()
    assert [found.data for found in splitter.feed(b"tail\r\n$whole\r\n", 0)] == [b"$whole"]


def test_known_until_the_start_of_the_line_in_progress_but_not_for_ever() -> None:
    splitter = LineSplitter()
    splitter.feed(b"$A\r\n", 100)
    assert splitter.complete_until(500) == 500
    splitter.feed(b"$B", 200)
    assert splitter.complete_until(500) == 200
    late = 200 + 2 * SLOWEST_LINE_NS
    assert splitter.complete_until(late) == late - SLOWEST_LINE_NS
    splitter.feed(b"\r", 300)
    assert splitter.complete_until(500) == 500
