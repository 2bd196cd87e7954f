"""Link protocol: the messages between board and station (docs/protocol.md), lease, window, bounded run.

One ROUTER socket on board, one DEALER for each client. A message is one MessagePack map with a `type`; a `frame`
message has a second part with the frame's bytes, unchanged from board to log.

    client -> board   hello      {schema, link, client, session}
    board  -> client  connected  {schema, link, boat_id, boot_id, clock_id, start_no, next_seq, clock_rate, config,
                                  versions, sensors, runs, unlisted}
    client -> board   lease      all that the board has to know to serve the client from here on (`Lease`), renewed
                                 every 100 to 500 ms; a newer one replaces it
    board  -> client  alive      {echo_ns, rx_ns, tx_ns, next_seq, gone}   the answer to every lease
                      frame      {boot_id, seq, k}     + frame bytes; k = 1..m in a bounded run
                      end        {sent, next_seq, reason}   ends the session, never the daemon
                      error      {what, cure}
    client -> board   command    {id, name, argument}
    board  -> client  done       {id, text}            or error {what, cure, id}
    client -> board   bye        {session}

The lease names no connection: whichever connection brings it is served. So a lost radio, a new address, a restarted
daemon or a restarted client heal by the next lease.
"""

import re
from dataclasses import dataclass
from typing import Any, Final

import msgpack

from common.errors import CodecError
from common.untrusted_msgpack import unpack_untrusted

MAX_HEADER_BYTES: Final = 16_384
"""Most bytes of a message to the board."""
MAX_GREETING_BYTES: Final = 262_144
"""Most bytes of `connected`: some five hundred sensors. Writers of files check it as readers do."""
MAX_RUN_FRAMES: Final = 10_000_000
MIN_PERIOD_S: Final = 0.05
MAX_PERIOD_S: Final = 60.0
HEARTBEAT_MS: Final = 1_000
HEARTBEAT_TIMEOUT_MS: Final = 4_000
LEASE_S: Final = 5.0
"""Life of a lease, s: a client that does not renew it is forgotten."""
RENEW_S: Final = 0.25
WINDOW_BYTES: Final = 24_576
"""Default window, bytes on their way to one client: 200 ms of a radio of 1 Mbit/s."""
MIN_WINDOW: Final = 1_024
MAX_WINDOW: Final = 2**20
MAX_MISSING: Final = 64
"""Most ranges in one lease."""
MAX_RUNS: Final = 1000
"""Most starts of the daemon that one greeting lists, the newest; it counts the others."""
MAX_SEQ: Final = 2**53
"""Highest number of a frame."""
MAX_CLOCK_RATE: Final = 1000.0
"""Most boat seconds in a real second, of a virtual boat."""
MAX_ARGUMENT: Final = 500
"""Most characters of a command's argument."""

TYPES: Final = (
    "hello", "connected", "lease", "alive", "frame", "end", "error", "command", "done", "bye",
)  # fmt: skip

_ID: Final = re.compile(r"[0-9a-f]{1,16}")
_INT_HIGH: Final = 2**63 - 1


@dataclass(frozen=True, slots=True)
class FrameRange:
    """Frames `first` to `last` (both included) of one daemon start."""

    boot_id: str
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class BoundedRun:
    """m frames in order, none skipped; `k` of them are received, the next begins with frame `seq` of `boot_id`."""

    m: int | None
    """Number of frames of the run; None = for ever: continuous in order, for a client that wants frames of another
    period."""
    k: int
    boot_id: str
    seq: int
    period_s: float | None
    """Period of the frames, s; None = the board's own frames."""


@dataclass(frozen=True, slots=True)
class Lease:
    """The whole state of a client, as it asks to be served from here on."""

    session: str
    """Identity that the client draws, 1 to 16 hex digits: the same over all its connections."""
    boot_id: str
    """`boot_id` of the last `connected`; the board greets again when it has another one."""
    window: int
    """Bytes of frames that may be on their way at once."""
    received: int
    """Bytes of frames received so far; only differences count."""
    t_ns: int
    """The client's clock, sent back in `alive`."""
    missing: tuple[FrameRange, ...] = ()
    """Frames to be sent again, oldest first."""
    run: BoundedRun | None = None
    """Bounded run in place of the newest frames and missing ones; None = none is asked for."""

    def as_fields(self) -> dict[str, Any]:
        """The message's fields."""
        fields: dict[str, Any] = {
            "session": self.session, "boot_id": self.boot_id, "window": self.window, "received": self.received,
            "t_ns": self.t_ns, "missing": [[item.boot_id, item.first, item.last] for item in self.missing],
        }  # fmt: skip
        if self.run is not None:
            run = {"m": self.run.m, "k": self.run.k, "boot_id": self.run.boot_id, "seq": self.run.seq}
            fields["run"] = {**run, "period_s": self.run.period_s}
        return fields


def pack(kind: str, **fields: Any) -> bytes:
    """One message header as bytes."""
    return bytes(msgpack.packb({"type": kind, **fields}, use_bin_type=True))


def unpack(data: bytes, limit: int = MAX_HEADER_BYTES) -> dict[str, Any]:
    """Bytes of a header -> its map, `type` checked; raises CodecError for anything else."""
    message = unpack_untrusted(data, limit)
    if not isinstance(message, dict) or message.get("type") not in TYPES:
        raise CodecError("not a message of this protocol")
    return message


def lease_of(message: dict[str, Any]) -> Lease:
    """The fields of a `lease` message, checked; raises CodecError that names the field at fault."""
    missing = message.get("missing", [])
    if not isinstance(missing, list) or len(missing) > MAX_MISSING:
        raise CodecError(f"missing must be a list of at most {MAX_MISSING} ranges")
    run = message.get("run")
    return Lease(
        session=_hex(message, "session"),
        boot_id=_hex(message, "boot_id"),
        window=_whole(message, "window", MIN_WINDOW, MAX_WINDOW),
        received=_whole(message, "received", 0, _INT_HIGH),
        t_ns=_whole(message, "t_ns", -_INT_HIGH, _INT_HIGH),
        missing=tuple(frame_ranges(missing)),
        run=None if run is None else _run_of(run),
    )


def check_greeting(message: dict[str, Any]) -> None:
    """The fields of a `connected` message that a station relies on; raises CodecError that names the one at fault."""
    for name in ("boot_id", "next_seq", "config", "runs"):
        if name not in message:
            raise CodecError(f"{name} is missing")
    _hex(message, "boot_id")
    _whole(message, "next_seq", 0, MAX_SEQ)
    if not isinstance(message["config"], dict):
        raise CodecError("config must be a map")
    runs, sensors, unlisted = message["runs"], message.get("sensors", []), message.get("unlisted", [0, 0])
    if not isinstance(runs, list) or not all(isinstance(run, list) and len(run) == 4 for run in runs):
        raise CodecError("runs must be a list of [boot_id, start_no, first_seq, next_seq]")
    for run in runs:
        fields = dict(zip(("boot_id", "start_no", "first_seq", "next_seq"), run, strict=True))
        _hex(fields, "boot_id")
        for name, most in (("start_no", _INT_HIGH), ("first_seq", MAX_SEQ), ("next_seq", MAX_SEQ)):
            _whole(fields, name, 0, most)
    if not isinstance(sensors, list) or not all(isinstance(sensor, dict) for sensor in sensors):
        raise CodecError("sensors must be a list of maps")
    rate = message.get("clock_rate", 1.0)
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0.0 < rate <= MAX_CLOCK_RATE:
        raise CodecError(f"clock_rate must be a number up to {MAX_CLOCK_RATE:g}")
    if not isinstance(unlisted, list) or len(unlisted) != 2:
        raise CodecError("unlisted must be [starts, frames]")
    for place in (0, 1):
        _whole({"unlisted": unlisted[place]}, "unlisted", 0, _INT_HIGH)


def check_end(message: dict[str, Any]) -> None:
    """The fields of an `end` message; raises CodecError that names the one at fault."""
    for name in ("sent", "next_seq"):
        if message.get(name) is not None:
            _whole(message, name, 0, MAX_SEQ)
    if not isinstance(message.get("reason", ""), str):
        raise CodecError("reason must be a text")


def command_id(message: dict[str, Any]) -> int:
    """The number of a command, 0 when it has none; raises CodecError."""
    return 0 if message.get("id") is None else _whole(message, "id", 0, _INT_HIGH)


def frame_ranges(items: Any) -> list[FrameRange]:
    """[[boot_id, first, last], ...] checked; raises CodecError."""
    if not isinstance(items, list):
        raise CodecError("ranges must be a list")
    ranges = []
    for item in items:
        if not isinstance(item, list) or len(item) != 3:
            raise CodecError("a range must be [boot_id, first, last]")
        fields = dict(zip(("boot_id", "first", "last"), item, strict=True))
        first = _whole(fields, "first", 0, _INT_HIGH)
        ranges.append(FrameRange(_hex(fields, "boot_id"), first, _whole(fields, "last", first, _INT_HIGH)))
    return ranges


def _run_of(run: Any) -> BoundedRun:
    if not isinstance(run, dict):
        raise CodecError("run must be a map")
    period_s = run.get("period_s")
    if period_s is not None:
        if isinstance(period_s, bool) or not isinstance(period_s, int | float):
            raise CodecError("period_s must be a number")
        if not MIN_PERIOD_S <= period_s <= MAX_PERIOD_S:
            raise CodecError(f"period_s must be from {MIN_PERIOD_S:g} to {MAX_PERIOD_S:g} s, got {period_s:g}")
    m = None if run.get("m") is None else _whole(run, "m", 1, MAX_RUN_FRAMES)
    k = _whole(run, "k", 0, MAX_RUN_FRAMES)
    return BoundedRun(m, k, _hex(run, "boot_id"), _whole(run, "seq", 0, _INT_HIGH), period_s)


def _hex(fields: dict[str, Any], name: str) -> str:
    value = fields.get(name)
    if not isinstance(value, str) or not _ID.fullmatch(value):
        raise CodecError(f"{name} must be 1 to 16 hex digits")
    return value


def _whole(fields: dict[str, Any], name: str, low: int, high: int) -> int:
    value = fields.get(name)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise CodecError(f"{name} must be a whole number from {low} to {high}")
    return value
