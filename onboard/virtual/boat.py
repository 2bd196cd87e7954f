"""The virtual boat: ports that speak at their baud rate on the boat clock. Its owner calls `advance` in a loop."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from common.clock import BoatClock
from common.units import NS_PER_S
from onboard.virtual.baud_pacing import Chunk, SerialLine, paced, portion_bytes
from onboard.virtual.terminal import Terminal

LEAD_NS: Final = NS_PER_S // 2
"""Boat time from the start signal to t = 0, ns, so that every reader can be ready for the first byte."""

Note = Callable[[dict[str, Any]], None]


class VirtualPort:
    """One terminal and the chunks that are still to come out of it."""

    def __init__(self, terminal: Terminal, chunks: Iterator[Chunk], note: Note) -> None:
        self.terminal = terminal
        self.silent = False
        self.dropped = 0
        """Number of bytes lost because they were not read; those of an unplugged or silent device were never sent."""
        self._chunks = chunks
        self._note = note
        self._next = next(chunks, None)
        self._whole = True

    @property
    def due_ns(self) -> int | None:
        """When the next chunk is due; `None` = all is out."""
        return None if self._next is None else self._next.due_ns

    def pump(self, now_ns: int) -> None:
        """Write what is due. A line is noted as sent when every byte of it went in."""
        while self._next is not None and self._next.due_ns <= now_ns:
            chunk = self._next
            self._whole = self._write(chunk.data) and self._whole
            if chunk.ends is not None:
                if self._whole:
                    self._note(chunk.ends.record)
                self._whole = True
            self._next = next(self._chunks, None)

    def _write(self, data: bytes) -> bool:
        if self.silent or not self.terminal.plugged:
            return False
        lost = len(data) - self.terminal.write(data)
        self.dropped += lost
        return lost == 0


class VirtualBoat:
    """All ports of one boat. `ports` may be unplugged, replugged and silenced at any time."""

    def __init__(self, directory: Path, clock: BoatClock, names: tuple[str, ...]) -> None:
        """Open the terminals under `directory`; nothing is sent before `start`."""
        self.clock = clock
        self.terminals = {name: Terminal(directory / name) for name in names}
        self.ports: dict[str, VirtualPort] = {}

    def start(self, lines: Mapping[str, Iterator[SerialLine]], bauds: Mapping[str, int], note: Note) -> None:
        """Begin to play: for each port its lines in time order; `note` is called with the record of each line sent."""
        for name, port_lines in lines.items():
            chunks = paced(port_lines, bauds[name], portion_bytes(bauds[name], self.clock.rate))
            self.ports[name] = VirtualPort(self.terminals[name], chunks, note)

    def advance(self) -> float | None:
        """Write everything due; real seconds until more is due, `None` when the last byte is out. Never blocks."""
        now_ns = self.clock.now_ns()
        for port in self.ports.values():
            port.pump(now_ns)
        dues = [due for port in self.ports.values() if (due := port.due_ns) is not None]
        return self.clock.seconds_until(min(dues)) if dues else None

    def unplug(self, port: str) -> None:
        """Pull the port's adapter; its device goes on measuring, unheard."""
        self.terminals[port].unplug()

    def replug(self, port: str) -> None:
        """Put the adapter back under the same name; a line then under way comes in truncated, as on a boat."""
        self.terminals[port].plug()

    def silence(self, port: str, silent: bool = True) -> None:
        """The port stays open, the device says nothing (or speaks again)."""
        self.ports[port].silent = silent

    @property
    def dropped_bytes(self) -> int:
        """Number of bytes lost because they were not read."""
        return sum(port.dropped for port in self.ports.values())

    def close(self) -> None:
        """Unplug everything and remove the names."""
        for terminal in self.terminals.values():
            terminal.unplug()
