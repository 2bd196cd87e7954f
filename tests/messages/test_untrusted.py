"""MessagePack from strangers: what msgpack writes is read, and no message takes memory with it."""

import random
import tracemalloc
from contextlib import suppress

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import CodecError
from common.untrusted_msgpack import MAX_DEPTH, unpack_untrusted

PLAIN = (
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats(allow_nan=False) | st.text() | st.binary()
)
VALUES = st.recursive(
    PLAIN, lambda inner: st.lists(inner, max_size=40) | st.dictionaries(st.text(), inner, max_size=40), max_leaves=60
)


def depth_of(value: object) -> int:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return max(map(depth_of, inner), default=0) + 1 if isinstance(value, dict | list) else 0


@given(VALUES)
def test_what_msgpack_writes_is_read_as_it_was(value: object) -> None:
    data = msgpack.packb(value, use_bin_type=True)
    if depth_of(value) <= MAX_DEPTH:
        assert unpack_untrusted(data, len(data)) == value
    else:
        with pytest.raises(CodecError):
            unpack_untrusted(data, len(data))
    for wrong in (data[:-1], data + b"\xc0"):
        with pytest.raises(CodecError):
            unpack_untrusted(wrong, 2**20)
    with pytest.raises(CodecError):
        unpack_untrusted(data, len(data) - 1)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_value_or_a_sentence(data: bytes) -> None:
    with suppress(CodecError):
        unpack_untrusted(data, 200)


@pytest.mark.parametrize(
    "bomb",
    [
        b"\xdc\x04\x00" * 1000,
        b"\x91" * 16_000,
        b"\x81\xa1a" * 5000,
        b"\xdd\xff\xff\xff\xff",
        b"\xdf\xff\xff\xff\xff",
        b"\xdc\x04\x00" + b"\xc0" * 1000,
        b"\x92\xdc\x04\x00" + b"\xc0" * 1024 + b"\xa1\xff",
        b"\x81\x91\x01\x01",
        b"\x81\x01\x01",
        b"\xdb\xff\xff\xff\xff",
        b"\xd6\xff" + b"\0" * 4,
        b"\xc1",
        b"",
    ],
)
def test_no_message_takes_memory_with_it(bomb: bytes) -> None:
    def refused(times: int) -> None:
        for _ in range(times):
            with pytest.raises(CodecError):
                unpack_untrusted(bomb, 16_384)

    refused(10)
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        refused(100)
        after, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 20_000
    assert peak - before < 200_000


def test_noise_between_sound_parts() -> None:
    draw = random.Random(5)
    sound = msgpack.packb({"type": "lease", "missing": [["ab", 1, 2]] * 20, "run": {"m": None, "k": 1}})
    for _ in range(2000):
        data = bytearray(sound)
        data[draw.randrange(len(data))] = draw.randrange(256)
        try:
            found = unpack_untrusted(bytes(data), 1000)
        except CodecError:
            continue
        assert found == msgpack.unpackb(bytes(data), strict_map_key=False)
