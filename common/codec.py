"""Serialisation of frames: MessagePack maps keyed by field name, `v` (schema version) first.

    data = encode_frame(frame)
    frame = decode_frame(data)          # raises CodecError: fixes[0].lat_deg: must be <= 90, got 91

Everything is derived from the annotations of `common.messages`, and every rule holds in both directions:

- `None` and defaults are left out; unknown keys are ignored; a required key that is absent is named.
- Times of measurements travel as `dt_us`, signed microseconds from the frame's `t0_ns` (`last_good_dt_us` likewise).
- `tuple[float, ...]` is a column of little-endian f32, `tuple[int, ...]` one of little-endian u32; the columns of one
  message have equal length. All other floats are f64. NaN and infinity are refused everywhere.
"""

import dataclasses
import typing
from collections.abc import Callable
from functools import partial
from operator import attrgetter
from typing import Any, Final, NamedTuple, get_args, get_origin

import msgpack

from common.errors import CodecError
from common.imu_columns import MAX_COLUMN, column_converters, column_format
from common.messages import Frame
from common.versions import SCHEMA_VERSION
from common.wire import (
    MAX_ENTRIES,
    Convert,
    Fault,
    decode_time,
    encode_time,
    list_converter,
    value_converter,
    whole_us_time,
    wrong_type,
)

MAX_FRAME_BYTES: Final = 1 << 20

_TIME_KEYS: Final = {"t_ns": "dt_us", "last_good_t_ns": "last_good_dt_us"}
_FRAME_TIMES: Final = ("t0_ns", "t1_ns")


def encode_frame(frame: Frame) -> bytes:
    """The frame as bytes; raises CodecError naming the field that is out of range, of a wrong type or not whole us."""
    try:
        fields = _encode_message(_FRAME, frame, getattr(frame, "t0_ns", 0))
        data = bytes(msgpack.packb({"v": SCHEMA_VERSION, **fields}, use_bin_type=True))
    except Fault as fault:
        raise CodecError(str(fault)) from None
    except UnicodeEncodeError as error:
        raise CodecError("a text holds lone surrogates, which are no characters") from error
    if len(data) > MAX_FRAME_BYTES:
        raise CodecError(f"frame of {len(data)} bytes is over the limit of {MAX_FRAME_BYTES}")
    return data


def decode_frame(data: bytes) -> Frame:
    """Bytes -> Frame; raises CodecError, and nothing else, for bytes that are no valid frame of this schema."""
    if len(data) > MAX_FRAME_BYTES:
        raise CodecError(f"frame of {len(data)} bytes is over the limit of {MAX_FRAME_BYTES}")
    try:
        fields = msgpack.unpackb(
            data, raw=False, strict_map_key=True, max_str_len=65_536, max_bin_len=4 * MAX_COLUMN,
            max_array_len=min(len(data), MAX_ENTRIES), max_map_len=min(len(data), MAX_ENTRIES), max_ext_len=0,
        )  # fmt: skip
    except Exception as error:  # msgpack raises its own errors, ValueError and UnicodeDecodeError
        raise CodecError(f"not a MessagePack message, or cut short ({type(error).__name__})") from error
    try:
        if type(fields) is not dict:
            raise wrong_type("a map", fields)
        return typing.cast("Frame", _decode_message(_FRAME, fields, _head(fields)))
    except Fault as fault:
        raise CodecError(str(fault)) from None


def _head(fields: dict[str, Any]) -> int:
    """The frame's t0_ns, which every other time needs, after the check that we may read the rest at all."""
    for key in ("v", "t0_ns"):
        if type(fields.get(key)) is not int:
            raise wrong_type("a whole number", fields[key]).under(key) if key in fields else Fault("missing").under(key)
    version, t0_ns = fields["v"], fields["t0_ns"]
    if version > SCHEMA_VERSION:
        text = f"schema {version} is newer than this side's {SCHEMA_VERSION}, install the same version on both sides"
        raise Fault(text).under("v")
    if version < 1:
        raise Fault(f"must be >= 1, got {version}").under("v")
    return int(t0_ns)


class _Message(NamedTuple):
    """One message class, compiled."""

    cls: type
    values: Callable[[Any], tuple[Any, ...]]
    """Function that gives all fields of a message, in the order of `outgoing`."""
    outgoing: tuple[tuple[str, Any, bool, Convert], ...]
    """Fields in order: key, value that is left out, whether an equal one may be left out too, encoder."""
    incoming: dict[str, tuple[str, bool, Convert]]
    """Key of a field -> its name, whether it may be None, and its decoder."""
    required: dict[str, None]
    """Keys that must be there, in the order of the fields."""
    columns: tuple[str, ...]


def _compile(cls: type) -> _Message:
    hints = typing.get_type_hints(cls, include_extras=True)
    fields = dataclasses.fields(cls)
    outgoing, incoming = [], {}
    required: dict[str, None] = {}
    for field in fields:
        key, encode, decode = _wire_form(cls, field.name, hints[field.name])
        default = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
        if default is dataclasses.MISSING:
            required[key] = None
        # The loop compares by identity first: most values are None, and == costs more than the rest of the turn.
        outgoing.append((key, default, default is not None and default is not dataclasses.MISSING, encode))
        incoming[key] = (field.name, type(None) in get_args(hints[field.name]), decode)
    values = attrgetter(*(field.name for field in fields))
    columns = tuple(name for name, hint in hints.items() if column_format(hint))
    return _Message(cls, values, tuple(outgoing), incoming, required, columns)


def _wire_form(cls: type, name: str, hint: Any) -> tuple[str, Convert, Convert]:
    """(key, encode, decode) of a field."""
    if name in _TIME_KEYS:
        return _TIME_KEYS[name], encode_time, decode_time
    if cls is Frame and name in _FRAME_TIMES:
        return name, whole_us_time, whole_us_time
    return name, *_converters(hint)


def _converters(hint: Any) -> tuple[Convert, Convert]:
    """(encode, decode) of a field; `tuple[SomeMessage, ...]` is a list of messages."""
    if code := column_format(hint):
        return column_converters(code)
    item = get_args(hint)[0] if get_origin(hint) is tuple else None
    if not dataclasses.is_dataclass(item):
        check = value_converter(hint)
        return check, check
    spec = _compile(typing.cast("type", item))
    return list_converter(partial(_encode_message, spec), tuple), list_converter(partial(_decode_message, spec), list)


def _encode_message(spec: _Message, message: Any, t0_ns: int) -> dict[str, Any]:
    if type(message) is not spec.cls:
        raise wrong_type(f"a {spec.cls.__name__}", message)
    fields: dict[str, Any] = {}
    values = spec.values(message)
    key = ""
    try:
        for value, (key, default, compare, encode) in zip(values, spec.outgoing, strict=True):
            if value is default or (compare and value == default):
                continue
            fields[key] = encode(value, t0_ns)
    except Fault as fault:
        raise fault.under(key) from None
    if spec.columns:
        _equal_lengths(spec, fields)
    return fields


def _decode_message(spec: _Message, fields: Any, t0_ns: int) -> Any:
    if type(fields) is not dict:
        raise wrong_type("a map", fields)
    values: dict[str, Any] = {}
    incoming = spec.incoming
    key = ""
    try:
        for key, value in fields.items():
            entry = incoming.get(key)
            if entry is not None:
                name, optional, decode = entry
                values[name] = None if optional and value is None else decode(value, t0_ns)
    except Fault as fault:
        raise fault.under(key) from None
    if not spec.required.keys() <= fields.keys():
        raise Fault("missing").under(next(key for key in spec.required if key not in fields))
    if spec.columns:
        _equal_lengths(spec, values)
    return spec.cls(**values)


def _equal_lengths(spec: _Message, columns: dict[str, Any]) -> None:
    if len({len(columns[name]) for name in spec.columns}) > 1:
        raise Fault(f"{', '.join(spec.columns)} must be of equal length")


_FRAME: Final = _compile(Frame)
