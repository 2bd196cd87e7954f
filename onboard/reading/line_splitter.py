"""Line framing with resynchronisation: the bytes of one port in, lines out.

A line ends at LF or CR; CR LF counts once because empty lines are silent (some compasses send CR alone).
Its time is that of the chunk that held its first byte. No more than `LONGEST_LINE` bytes are ever held: what is longer
is discarded up to the next line end.

Packets of u-blox' binary protocol are taken out first (`ubx_packets`): they are no lines, and no damage.

Two sentences run together by a lost line end come out as one line: only a decoder knows that `$` or `!` may not stand
in the middle, and it rejects them (`onboard.devices.nmea_sentence`).
"""

from typing import Final

from onboard.devices.driver import Line
from onboard.reading.ubx_packets import LONGEST_HOLD_NS, UbxPackets

LONGEST_LINE: Final = 512
"""Most bytes of one line: six times the NMEA limit, so that the long lines of radars and IMUs pass."""
SLOWEST_LINE_NS: Final = LONGEST_HOLD_NS
"""Time that `LONGEST_LINE` takes at 4800 baud, ns: a partial line older than this is no line in progress."""

_LINE_START: Final = b"$!%\\"
"""First bytes of sentences, of KVH's own lines and of tag blocks."""


class LineSplitter:
    """Cuts the bytes of one port into lines. Counters run since creation and may be read at any time.

    Every byte fed is in a line, is a line end, is in `discarded_bytes`, in `packet_bytes` or in `pending_bytes`.
    """

    def __init__(self) -> None:
        self.lines = 0
        """Number of lines given out."""
        self.overflows = 0
        """Number of lines thrown away for their length."""
        self.discarded_bytes = 0
        """Number of bytes in lines too long or cut, line ends not counted."""
        self._packets = UbxPackets()
        self._pending = bytearray()
        self._t_ns = 0
        self._resync = False
        self._fresh = False

    @property
    def pending_bytes(self) -> int:
        """Number of bytes in the line in progress."""
        return len(self._pending)

    @property
    def packet_bytes(self) -> int:
        """Number of bytes in UBX packets, one in progress included."""
        return self._packets.packet_bytes + self._packets.held_bytes

    def feed(self, data: bytes, t_ns: int) -> list[Line]:
        """The lines that `data`, stamped `t_ns`, completes, oldest first.

        Without data: those that the time completes, because what began like a packet of UBX does not go on.
        """
        lines: list[Line] = []
        for then_ns, text in self._packets.text(data, t_ns):
            self._split(text, then_ns, lines)
        return lines

    def note_cut(self) -> None:
        """Bytes were lost here (byte budget): discard the line in progress and on to the next line end."""
        self._discard_pending()
        self.discarded_bytes += self._packets.reset()
        self._resync = True

    def reset(self) -> None:
        """The port was opened again: as `note_cut`, unless the first byte to come is the start of a sentence."""
        self.note_cut()
        self._fresh = True

    def complete_until(self, now_ns: int) -> int:
        """The time up to which all lines are known: `now_ns`, or the start of the line or packet in progress.

        The time that packets took since the last line is left out too: the device could send no line in it. Timeouts
        between lines (`Driver.flush`) are judged at this time, so that a slow baud rate is no silence.
        """
        begins = [self._t_ns] if self._pending else []
        if (held_ns := self._packets.held_ns) is not None:
            begins.append(held_ns)
        known_ns = min([now_ns, *begins]) - self._packets.busy_ns
        return min(now_ns, max(known_ns, now_ns - SLOWEST_LINE_NS))

    def _split(self, data: bytes, t_ns: int, lines: list[Line]) -> None:
        if self._fresh and data:
            self._fresh = False
            self._resync = data[0] not in _LINE_START
        *whole, rest = data.replace(b"\r", b"\n").split(b"\n")
        for piece in whole:
            if piece:
                self._add(piece, t_ns)
            self._end(t_ns, lines)
        if rest:
            self._add(rest, t_ns)

    def _add(self, piece: bytes, t_ns: int) -> None:
        if self._resync:
            self.discarded_bytes += len(piece)
            return
        if len(self._pending) + len(piece) > LONGEST_LINE:
            self._discard_pending()
            self.discarded_bytes += len(piece)
            self.overflows += 1
            self._resync = True
            return
        if not self._pending:
            self._t_ns = t_ns
        self._pending += piece

    def _end(self, t_ns: int, lines: list[Line]) -> None:
        self._resync = False
        if self._pending:
            lines.append(Line(self._t_ns, bytes(self._pending), t_ns))
            self._pending.clear()
            self._packets.busy_ns = 0
            self.lines += 1

    def _discard_pending(self) -> None:
        self.discarded_bytes += len(self._pending)
        self._pending.clear()
