"""Liveness mark (heartbeat file): when the former run's last frame ended, should it have died without a goodbye.

It lies in the runtime directory, which is memory: nothing is worn, and a reboot forgets it. Frames of one machine's
uptime only can be compared, so with another clock id nothing is reported.
"""

import contextlib
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from common.framer import Identity

_LINE: Final = re.compile(r"([0-9a-f]{32}) ([0-9a-f]{16}) (\d{20})\n")


@dataclass(frozen=True, slots=True)
class Gap:
    """No frames for this long, since the end of the last frame of run `boot_id`."""

    boot_id: str
    gap_ns: int


def line_of(identity: Identity, t1_ns: int) -> bytes:
    """The mark: always equally long, so that it is overwritten in place and never half there."""
    return f"{identity.clock_id} {identity.boot_id} {t1_ns:020d}\n".encode("ascii")


def gap_of(line: str, clock_id: str, t0_ns: int) -> Gap | None:
    """The gap that a mark found at start shows; None for a damaged or foreign one. t0_ns: start of the first frame."""
    match = _LINE.fullmatch(line)
    if match is None or match[1] != clock_id or int(match[3]) > t0_ns:
        return None
    return Gap(boot_id=match[2], gap_ns=t0_ns - int(match[3]))


class AliveMark:
    """The mark's file; without a directory, or when it cannot be written, there is none and nothing is reported."""

    def __init__(self, directory: Path | None, identity: Identity) -> None:
        self._identity = identity
        self._file = None if directory is None else directory / "alive"
        self._fd: int | None = None

    def former(self, t0_ns: int) -> Gap | None:
        """The gap since the former run, if that ended without a goodbye. Ask before the first `keep`."""
        if self._file is None:
            return None
        try:
            line = self._file.read_text(encoding="ascii")
        except (OSError, ValueError):
            return None
        return gap_of(line, self._identity.clock_id, t0_ns)

    def keep(self, t1_ns: int) -> None:
        """A frame that ends at t1 is out."""
        if self._file is None:
            return
        try:
            if self._fd is None:
                self._fd = os.open(self._file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
            os.pwrite(self._fd, line_of(self._identity, t1_ns), 0)
        except OSError:
            self._file = None

    def goodbye(self) -> None:
        """The daemon ends in good order."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._file.unlink(missing_ok=True)
