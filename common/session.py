"""The link's vocabulary, first form (docs/protocol.md).

One ROUTER socket on board, one DEALER for each client. A message is one MessagePack map with a `type`; a `frame`
message has a second part with the frame's bytes, unchanged from board to log.

    client -> board   hello      {schema, client}
    board  -> client  connected  {schema, boat_id, boot_id, clock_id, start_no, next_seq, clock_rate, config, versions,
                                  sensors}
    client -> board   run        {m, period_s}      m frames of one period each, in order, none skipped, then `end`;
                                                    without period_s the board's own frames
                      run        {}                 continuous: every frame from `next_seq` on, until bye or end
    board  -> client  frame      {k}                + frame bytes; k = 1..m
                      end        {sent, next_seq, reason}   ends the session, never the daemon
                      error      {what, cure}
    client -> board   bye        {}

`sensors` lists every configured sensor: {id, state: delivering | silent | missing, reason}.
"""

from typing import Any, Final

import msgpack

from common.errors import CodecError
from common.messages import SCHEMA_VERSION

MAX_HEADER_BYTES: Final = 65_536
MAX_RUN_FRAMES: Final = 10_000_000
MIN_PERIOD_S: Final = 0.05
MAX_PERIOD_S: Final = 60.0
HEARTBEAT_MS: Final = 1_000
HEARTBEAT_TIMEOUT_MS: Final = 4_000

TYPES: Final = ("hello", "connected", "run", "frame", "end", "error", "bye")


def pack(kind: str, **fields: Any) -> bytes:
    """One message header as bytes."""
    return bytes(msgpack.packb({"type": kind, **fields}, use_bin_type=True))


def unpack(data: bytes) -> dict[str, Any]:
    """Bytes of a header -> its map, `type` checked; raises CodecError for anything else."""
    if len(data) > MAX_HEADER_BYTES:
        raise CodecError(f"message of {len(data)} bytes is over the limit of {MAX_HEADER_BYTES}")
    try:
        message = msgpack.unpackb(
            data, raw=False, strict_map_key=True, max_str_len=4096, max_bin_len=4096,
            max_array_len=1024, max_map_len=1024, max_ext_len=0,
        )  # fmt: skip
    except Exception as error:  # msgpack raises its own errors, ValueError and UnicodeDecodeError
        raise CodecError(f"not a MessagePack message ({type(error).__name__})") from error
    if not isinstance(message, dict) or message.get("type") not in TYPES:
        raise CodecError("not a message of this protocol")
    return message


def schema_fault(other: object) -> str | None:
    """Why we cannot talk to a peer of schema `other`, or `None`: the numbers must be equal (`SCHEMA_VERSION`)."""
    if not isinstance(other, int) or isinstance(other, bool):
        return "the other side names no schema version"
    if other == SCHEMA_VERSION:
        return None
    newer = "the other side" if other > SCHEMA_VERSION else "this side"
    return f"schema {other} there, {SCHEMA_VERSION} here: {newer} is newer, install the same version on both"
