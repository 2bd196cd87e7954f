"""Any bytes at all: CodecError and nothing else, within bounded memory."""

import random
import tracemalloc

import pytest

from common.codec import decode_frame, encode_frame
from common.errors import CodecError
from tests.strategies import BLOCK, FIX, MESSAGES, frame_of, sample


def decode_or_refuse(data: bytes) -> bool:
    """True when `data` was a valid frame; a decoded frame must be one that can be encoded again."""
    try:
        frame = decode_frame(data)
    except CodecError:
        return False
    assert decode_frame(encode_frame(frame)) == frame
    return True


def seed_frame() -> bytes:
    everything = [sample(cls) for cls in MESSAGES]
    return encode_frame(frame_of(FIX, BLOCK, *everything, utc_ns=1, utc_src="gnss"))


def mutate(data: bytes, rng: random.Random) -> bytes:
    mutated = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(mutated))
        action = rng.randrange(4)
        if action == 0:
            mutated[at] = rng.randrange(256)
        elif action == 1:
            mutated[at] ^= 1 << rng.randrange(8)
        elif action == 2:
            del mutated[at : at + rng.randint(1, 8)]
        else:
            mutated[at:at] = rng.randbytes(rng.randint(1, 8))
        if not mutated:
            break
    return bytes(mutated)


def test_5000_random_and_mutated_byte_strings_raise_nothing_but_codec_errors() -> None:
    rng = random.Random(1)
    seed = seed_frame()
    accepted = 0
    tracemalloc.start()
    for _ in range(2500):
        decode_or_refuse(rng.randbytes(rng.randint(0, 400)))
        accepted += decode_or_refuse(mutate(seed, rng))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert 0 < accepted < 2500  # some mutations hit text or numbers only, most are noticed
    assert peak < 16_000_000


def test_every_cut_of_a_frame_is_refused() -> None:
    seed = seed_frame()
    assert decode_or_refuse(seed)
    assert not any(decode_or_refuse(seed[:length]) for length in range(len(seed)))
    assert not decode_or_refuse(seed + b"\x00")


@pytest.mark.parametrize(
    "bomb",
    [
        b"\x91" * 100_000,
        b"\xdc\x20\x00" * 300_000,
        b"\xdd\xff\xff\xff\xff" * 1000,
        b"\xdf\xff\xff\xff\xff" * 1000,
        b"\xdb\xff\xff\xff\xff" * 1000,
        b"\xc9\xff\xff\xff\xff\x01",
        b"\x81\xa1v\xc7\x08\xff" + bytes(8),
        b"",
        b"\xc1",
    ],
)
def test_bombs_are_refused_within_bounded_memory(bomb: bytes) -> None:
    tracemalloc.start()
    assert not decode_or_refuse(bomb)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 80_000_000
