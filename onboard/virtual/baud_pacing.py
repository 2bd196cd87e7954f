"""Serial line timing: when each byte of a device reaches the board, by baud rate and queueing. Pure.

Ten bits a byte (8N1). A line is never faster than the baud rate and never overtakes the line before it.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from onboard.recorded.line_times import BITS_PER_BYTE, time_on_wire_ns

FIFO_BYTES = 16
"""Size of a UART's buffer, bytes: it hands its bytes over in portions of this size."""


@dataclass(frozen=True, slots=True)
class SerialLine:
    """Bytes that go out together, and what to note once all of them are out."""

    ready_ns: int
    """Boat time at which the first byte reaches the board, ns, if the port is free."""
    data: bytes
    record: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes that reach the board together at `due_ns`."""

    due_ns: int
    data: bytes
    ends: SerialLine | None = None
    """The line whose last byte this is."""


def portion_bytes(baud: int, clock_rate: float, shortest_real_s: float = 0.001) -> int:
    """Chunk size: one FIFO, or at high clock rates what comes in a millisecond of real time, to spare the processor."""
    return max(FIFO_BYTES, round(baud / BITS_PER_BYTE * clock_rate * shortest_real_s))


def paced(lines: Iterable[SerialLine], baud: int, chunk_bytes: int) -> Iterator[Chunk]:
    """Cut lines into timed chunks. The first byte of a line goes alone: the reader's time stamp is taken from it."""
    free_ns = 0
    for line in lines:
        start_ns = max(line.ready_ns, free_ns)
        begin, end = 0, 1
        while begin < len(line.data):
            due_ns = start_ns + time_on_wire_ns(end - 1, baud)
            last = end >= len(line.data)
            yield Chunk(due_ns, line.data[begin:end], line if last else None)
            begin, end = end, min(end + chunk_bytes, len(line.data))
        free_ns = start_ns + time_on_wire_ns(len(line.data), baud)
