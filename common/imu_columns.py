"""Packed columns of IMU blocks: the samples of a field are one little-endian array of 32-bit numbers."""

import math
import struct
from typing import Any, Final

from common.wire import Convert, Fault, wrong_type

MAX_COLUMN: Final = 65_536
"""Samples in one column: a minute of a 1 kHz IMU."""


def column_format(hint: Any) -> str | None:
    """The struct letter of a column's entries, or `None` when the field is no column."""
    return {tuple[float, ...]: "f", tuple[int, ...]: "I"}.get(hint)


def column_converters(code: str) -> tuple[Convert, Convert]:
    """(encode, decode) of a column whose entries have this struct letter."""
    return _encoder(code), _decoder(code)


def _encoder(code: str) -> Convert:
    def encode(values: Any, _t0_ns: int) -> bytes:
        if not isinstance(values, tuple) or bool in map(type, values):
            raise wrong_type("a column of numbers", values)
        if len(values) > MAX_COLUMN:
            raise Fault(f"must have at most {MAX_COLUMN} samples, got {len(values)}")
        try:
            data = struct.pack(f"<{len(values)}{code}", *values)
        except (struct.error, OverflowError, TypeError) as error:
            raise Fault(f"a sample does not fit in 32 bits ({error})") from None
        if not math.isfinite(sum(values)):
            raise Fault("every sample must be finite")
        return data

    return encode


def _decoder(code: str) -> Convert:
    def decode(data: Any, _t0_ns: int) -> tuple[Any, ...]:
        if type(data) is not bytes:
            raise wrong_type("a column (bytes)", data)
        count, rest = divmod(len(data), 4)
        if rest:
            raise Fault(f"must be whole 32-bit samples, got {len(data)} bytes")
        values = struct.unpack(f"<{count}{code}", data)
        # f32 cannot overflow an f64 sum, so the sum is finite exactly when every sample is.
        if not math.isfinite(sum(values)):
            raise Fault("every sample must be finite")
        return values

    return decode
