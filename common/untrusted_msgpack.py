"""Hardened MessagePack decoder for untrusted input: messages of strangers, a few levels deep.

msgpack's decoder loses memory with every message that ends inside a list (1.0.3: 7 MB by one message of 3 kB). So here
it decodes plain values only; lists and maps are taken apart one by one, a few deep.
"""

from typing import Any, Final

import msgpack

from common.errors import CodecError

MAX_DEPTH: Final = 6
MAX_ENTRIES: Final = 1024
"""Most entries of one list or map."""
MAX_TEXT_BYTES: Final = 4096
"""Most bytes of one text; of a message that may be longer than 16 kB a quarter of its limit."""


def unpack_untrusted(data: bytes, limit: int) -> Any:
    """The value in at most so many bytes; raises CodecError for whatever is not MessagePack of a modest shape."""
    if len(data) > limit:
        raise CodecError(f"message of {len(data)} bytes is over the limit of {limit}")
    longest = max(MAX_TEXT_BYTES, limit // 4)
    unpacker = msgpack.Unpacker(
        max_buffer_size=limit, raw=False, max_str_len=longest, max_bin_len=longest, max_ext_len=0
    )
    try:
        unpacker.feed(data)
        value = _value(unpacker, data, MAX_DEPTH)
    except CodecError:
        raise
    except Exception as error:  # msgpack raises its own errors, ValueError and UnicodeDecodeError
        raise CodecError(f"not a MessagePack message ({type(error).__name__})") from error
    if unpacker.tell() != len(data):
        raise CodecError("more than one MessagePack value")
    return value


def _value(unpacker: msgpack.Unpacker, data: bytes, depth: int) -> Any:
    at = unpacker.tell()
    lead = data[at] if at < len(data) else 0xC1  # a byte that MessagePack never uses
    is_map = 0x80 <= lead <= 0x8F or lead in (0xDE, 0xDF)
    if not is_map and not 0x90 <= lead <= 0x9F and lead not in (0xDC, 0xDD):
        return unpacker.unpack()
    entries = unpacker.read_map_header() if is_map else unpacker.read_array_header()
    if entries > MAX_ENTRIES or depth == 0:
        raise CodecError("a list or map that is too large or too deep")
    if not is_map:
        return [_value(unpacker, data, depth - 1) for _ in range(entries)]
    made = {}
    for _ in range(entries):
        name = _value(unpacker, data, 0)
        if not isinstance(name, str):
            raise CodecError("a map's name is not a text")
        made[name] = _value(unpacker, data, depth - 1)
    return made
