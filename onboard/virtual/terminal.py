"""A pseudo-terminal (pty) under a stable name, which can be pulled out and put back like a USB adapter."""

import contextlib
import os
import tty
from pathlib import Path


class Terminal:
    """One virtual serial port: `link` is the path to open. It is plugged in from the start.

    A slave end stays open here, so that the raw mode persists and writing needs no reader. Nothing paces a
    pseudo-terminal: the caller does. A port without a reader holds about 20 kB and then loses bytes, like a UART.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self._master: int | None = None
        self._keeper = -1
        self.plug()

    @property
    def plugged(self) -> bool:
        """Whether the adapter is in."""
        return self._master is not None

    def plug(self) -> None:
        """Put the adapter (back) in: a new pseudo-terminal under the same name."""
        if self._master is not None:
            return
        self._master, self._keeper = os.openpty()
        # A fresh pseudo-terminal is cooked and echoes: raw before the first byte.
        tty.setraw(self._keeper)
        os.set_blocking(self._master, False)
        fresh = self.link.with_name(f".{self.link.name}.new")
        fresh.unlink(missing_ok=True)
        # Not by its number in /dev/pts: once this process was killed, that is the next pseudo-terminal of any program.
        fresh.symlink_to(f"/proc/{os.getpid()}/fd/{self._keeper}")
        # Replaced in one step: a reader sees the old or the new device, never no link.
        fresh.replace(self.link)

    def unplug(self) -> None:
        """Pull the adapter: a reader sees an end of file or EIO, and the name is gone."""
        if self._master is None:
            return
        # The name goes first: the next file that this process opens may get the descriptor it leads to.
        self.link.unlink(missing_ok=True)
        os.close(self._keeper)
        os.close(self._master)
        self._master = None

    def write(self, data: bytes) -> int:
        """Bytes that went in (fewer than given without a reader, 0 when unplugged); never blocks."""
        if self._master is None:
            return 0
        with contextlib.suppress(BlockingIOError):
            return os.write(self._master, data)
        return 0
