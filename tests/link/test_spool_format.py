"""The bytes of a segment: what is written is read, and whatever happens to them no wrong frame is."""

import random
import re
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.spool.segment_format import (
    END,
    FRAME,
    Damage,
    Header,
    Name,
    Record,
    last_seq_of,
    name_of,
    pack_header,
    pack_record,
    scan,
    seed_of,
    unpack_header,
)
from tests.link.spooling import filled, identity, payload

BOOT = identity().boot_id
SEED = seed_of(BOOT)
PAGE = Path(__file__).parents[2] / "docs" / "spool-format.md"

frames = st.lists(st.binary(max_size=60) | st.just(b"\xf5WFR" * 9), max_size=12)


def packed(items: list[bytes]) -> tuple[bytes, list[int]]:
    """Records of frames 0, 3, 6, ... and where each ends."""
    data, ends = b"", []
    for number, item in enumerate(items):
        data += pack_record(3 * number, item, SEED)
        ends.append(len(data))
    return data, ends


def found(data: bytes, seed: int = SEED) -> list[tuple[int, bytes]]:
    items = list(scan(data, 0, seed))
    edges = [edge for item in items for edge in ((item.start, item.end))]
    assert edges[::2] == [0, *edges[1:-1:2]][: len(edges[::2])]  # without a hole
    assert not data or edges[-1] == len(data)
    return [(item.seq, data[item.body : item.end]) for item in items if isinstance(item, Record)]


@given(frames)
def test_what_is_packed_is_found(items: list[bytes]) -> None:
    data, _ = packed(items)
    assert found(data) == [(3 * number, item) for number, item in enumerate(items)]
    assert not any(isinstance(item, Damage) for item in scan(data, 0, SEED))
    assert found(data, seed_of("f" * 16)) == []  # a block of another start
    if items:
        assert last_seq_of(data, SEED) == 3 * len(items) - 3
        assert last_seq_of(data + pack_record(3 * len(items), b"", SEED, END), SEED) == 3 * len(items) - 1


@given(frames, st.data())
def test_cut_anywhere(items: list[bytes], draw: st.DataObject) -> None:
    data, ends = packed(items)
    cut = draw.draw(st.integers(0, len(data)))
    zeros = draw.draw(st.integers(0, 100))
    whole = sum(end <= cut for end in ends)
    assert found(data[:cut] + bytes(zeros)) == [(3 * number, item) for number, item in enumerate(items[:whole])]


@given(frames, st.lists(st.tuples(st.integers(0, 2000), st.integers(1, 255)), min_size=1, max_size=4))
def test_damage_in_the_middle_costs_only_what_it_hits(items: list[bytes], hits: list[tuple[int, int]]) -> None:
    data, ends = packed(items)
    harmed = bytearray(data)
    for at, mask in hits:
        if harmed:
            harmed[at % len(harmed)] ^= mask
    expected = []
    for number, (item, end) in enumerate(zip(items, ends, strict=True)):
        begin = ends[number - 1] if number else 0
        if harmed[begin:end] == data[begin:end]:
            expected.append((3 * number, item))
    assert found(bytes(harmed)) == expected


@given(st.binary(max_size=400), st.binary(max_size=20))
def test_bytes_of_no_kind(data: bytes, more: bytes) -> None:
    for seed in (0, SEED):
        assert all(isinstance(item, Damage) for item in scan(data + b"\xf5WFR" + more, 0, seed))
    assert unpack_header(data) is None
    assert unpack_header(b"WFSPOOL\x1a" + data) is None


def test_a_step_back_is_damage() -> None:
    """An old block of the same start that the file system shows again."""
    data = pack_record(7, b"new", SEED) + pack_record(3, b"old", SEED) + pack_record(8, b"next", SEED)
    assert found(data) == [(7, b"new"), (8, b"next")]


@given(
    st.integers(0, 2**40), st.integers(-1, 2**40), st.dictionaries(st.text(max_size=5), st.integers(0, 9), max_size=3)
)
def test_header(first: int, after: int, about: dict[str, int]) -> None:
    header = Header(identity(), first, after, about)
    data = pack_header(header)
    assert unpack_header(data + b"more") == (header, len(data))
    harmed = bytearray(data)
    harmed[random.Random(first).randrange(len(data))] ^= 1 << (first % 8)
    assert unpack_header(bytes(harmed)) is None


def test_a_header_leaves_out_what_is_too_long() -> None:
    data = pack_header(Header(identity(), 0, -1, {"config": "x" * 70_000}))
    head = unpack_header(data)
    assert head is not None
    assert head[0].about == {}


@given(st.integers(0, 10**12), st.integers(0, 10**15))
def test_names_sort_like_starts_and_frames(number: int, seq: int) -> None:
    name = Name(number, seq, BOOT)
    assert name_of(str(name)) == name
    assert name_of(f"x{name}") is None
    assert name_of(str(name).removesuffix("seg")) is None
    assert str(Name(1, 10, "f" * 16)) < str(Name(2, 0, "0" * 16)) < str(Name(10, 0, "0" * 16))


def test_the_reader_of_the_page(tmp_path: Path) -> None:
    """docs/spool-format.md is enough: its 25 lines know nothing of our code."""
    filled(tmp_path / "spool", 300)
    (file,) = (tmp_path / "spool").glob("*.seg")
    data = bytearray(file.read_bytes())
    at = data.index(payload(100))
    data[at] ^= 1
    file.write_bytes(data)
    code = re.search(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    assert code is not None
    assert len(code[1].splitlines()) <= 25
    assert "onboard" not in code[1]
    names: dict[str, object] = {"__name__": "reader"}
    exec(code[1], names)
    head, records = names["read_segment"](str(file))  # type: ignore[operator]
    assert head["boot_id"] == BOOT
    assert [item for item in records if item[0] != 100] == [(seq, payload(seq)) for seq in range(300) if seq != 100]
    assert len(records) == 299


def test_the_layout_is_that_of_the_page() -> None:
    record = pack_record(5, b"abc", SEED)
    magic, flags, length, seq, _ = struct.unpack_from("<4sIIQI", record)
    assert (magic, flags, length, seq, record[24:]) == (b"\xf5WFR", FRAME, 3, 5, b"abc")


@pytest.mark.parametrize("size", [0, 1, 7])
def test_an_empty_or_tiny_file_holds_nothing(size: int) -> None:
    assert found(bytes(size)) == []
    assert last_seq_of(bytes(size), SEED) is None
