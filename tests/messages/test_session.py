"""Headers of the link: there and back, limits, and nothing but CodecError for any bytes."""

import random
from typing import Any

import msgpack
import pytest

from common import link_messages as session
from common.errors import CodecError
from common.versions import SCHEMA_VERSION, schema_fault


@pytest.mark.parametrize("kind", session.TYPES)
def test_a_header_comes_back(kind: str) -> None:
    fields: dict[str, Any] = {"m": 5, "period_s": 0.1, "config": {"boat": {"id": "b"}}, "sensors": [{"id": "gps1"}]}
    assert session.unpack(session.pack(kind, **fields)) == {"type": kind, **fields}


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",
        msgpack.packb([1]),
        msgpack.packb({"type": "launch"}),
        msgpack.packb({"no": "type"}),
        msgpack.packb({"type": ["hello"]}),
        msgpack.packb({"type": "hello", 1: 2}),
        session.pack("hello", client="x" * 5000),
        session.pack("hello", client=b"x" * 5000),
        session.pack("hello", many=[0] * 2000),
        session.pack("hello") + b"\x00",
        session.pack("hello")[:-1],
        session.pack("hello", **{f"key{number}": "x" * 4000 for number in range(20)}),
    ],
)
def test_what_is_no_header_is_refused(data: bytes) -> None:
    with pytest.raises(CodecError):
        session.unpack(data)


def test_any_bytes_raise_nothing_but_codec_error() -> None:
    rng = random.Random(5)
    seed = session.pack("connected", config={"boat": {"id": "b"}}, sensors=[{"id": "gps1"}], next_seq=5)
    for _ in range(3000):
        mutated = bytearray(seed)
        mutated[rng.randrange(len(seed))] = rng.randrange(256)
        for data in (bytes(mutated), rng.randbytes(rng.randint(0, 60))):
            try:
                assert session.unpack(data)["type"] in session.TYPES
            except CodecError:
                continue


def test_schema_fault_says_which_side_is_newer() -> None:
    assert schema_fault(SCHEMA_VERSION) is None
    assert "the other side is newer" in str(schema_fault(SCHEMA_VERSION + 1))
    assert "this side is newer" in str(schema_fault(SCHEMA_VERSION - 1))
    for nothing in (None, "1", True, 1.0):
        assert "no schema version" in str(schema_fault(nothing))
