"""The checksum of a sentence, against the definition."""

from functools import reduce
from operator import xor

from hypothesis import given
from hypothesis import strategies as st

from onboard.devices.nmea_sentence import LONGEST_SENTENCE, checksum


@given(st.binary(max_size=LONGEST_SENTENCE))
def test_checksum_is_the_exclusive_or_of_all_bytes(data: bytes) -> None:
    assert checksum(data) == reduce(xor, data, 0)


def test_checksum_of_the_longest_sentence() -> None:
    assert checksum(b"\x00" * 511 + b"\x5a") == 0x5A
    assert checksum(b"\x5a" + b"\x00" * 511) == 0x5A
