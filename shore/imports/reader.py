"""Reader interface of foreign recordings: what every reader does, and the sensors that it finds on its way."""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import TextIOWrapper
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, Protocol

from common.boat_config import IMU_AXES, BoatTable, SensorTable
from common.errors import WayfixError
from common.framer import Measurement
from shore.imports.line_counts import Account
from shore.imports.text_encoding import UTF16, encoding_of


class ForeignRecord(NamedTuple):
    """Something in a recording that may hold measurements."""

    t_ns: int | None
    """The record's own time (UTC, or counted from any moment), ns in whole us; `None` = it has none."""
    content: Any
    source: str = ""
    """Device or source whose clock gave the time; empty = the only one."""


class RecordingReader(Protocol):
    """One pass over a recording. Counts everything it sees in its accounts, exactly once."""

    accounts: tuple[Account, ...]
    boat: BoatTable
    is_utc: bool
    """True when the times of the records are UTC."""
    notes: list[str]
    """What a person should know about the pass."""
    sources: "Sources"
    """Sensors by source; the second pass over a file is given those of the first."""

    def records(self) -> Iterator[ForeignRecord]:
        """Records that may hold measurements, in the order of the file; everything else is counted and passed over."""

    def measure(self, record: ForeignRecord, t_ns: int) -> Iterator[Measurement]:
        """The measurements of a record at this boat time; they are counted."""

    def leave_out(self, record: ForeignRecord, reason: str, /) -> None:
        """Count a record without a time that could be used."""

    def sensors(self, rates_hz: dict[str, float | None]) -> tuple[SensorTable, ...]:
        """The sensors that were found in the pass, each with what it says of itself."""


@dataclass(slots=True)
class Sources:
    """Sensor ids (role + number) of the sources of a recording, in the order in which they first speak."""

    names: dict[tuple[str, str], str] = field(default_factory=dict)
    """Sensor id by role and source."""

    def id_of(self, role: str, source: str) -> str:
        """The id of the sensor with this role at a source."""
        key = (role, source)
        if key not in self.names:
            self.names[key] = f"{role}{1 + sum(known == role for known, _ in self.names)}"
        return self.names[key]

    def tables(self, port: str, rates_hz: dict[str, float | None]) -> tuple[SensorTable, ...]:
        """`[[sensor]]` of each that measured anything, by role and number.

        How the IMU of another boat is mounted is not known: it is recorded, not fused.
        """
        return tuple(
            SensorTable(
                id=sensor,
                port=port,
                role=role,
                rate_hz=rates_hz[sensor],
                use=() if role == "imu" else IMU_AXES,
            )
            for (role, source), sensor in sorted(self.names.items(), key=lambda item: (item[0][0], item[1]))
            if sensor in rates_hz and not (role == "gyro" and ("compass", source) in self.names)
        )

    def as_record(self) -> dict[str, str]:
        """Sensor id -> source, for the log."""
        return {sensor: source for (_, source), sensor in self.names.items()}


class Lines:
    """The lines of a text file, read as they are needed."""

    def __init__(self, path: Path, progress: Callable[[int], None] | None = None) -> None:
        """progress: called with the number of bytes of each line."""
        self._path = path
        self._progress = progress

    def __iter__(self) -> Iterator[str]:
        """Each line that is not empty, without its end; UTF-16 (of PowerShell) by its mark, else UTF-8.

        A byte that is no such text becomes a question mark of Unicode.
        """
        with opened(self._path) as stream:
            is_utf16 = encoding_of(stream.read(2)) == UTF16
            stream.seek(0)
            # Its lines end in the middle of a character of two bytes.
            pieces = TextIOWrapper(stream, UTF16, errors="replace") if is_utf16 else map(decoded, _pieces(stream))
            for piece in pieces:
                if self._progress:
                    self._progress(len(piece) * (2 if is_utf16 else 1))
                for line in piece.replace("\r", "\n").split("\n"):
                    if line.strip():
                        yield line


LONGEST_LINE: int = 1 << 22
"""Longest line, bytes; a longer one is cut there, and is not a record."""


def decoded(data: bytes) -> str:
    """UTF-8 without its mark."""
    return data.decode("utf-8", errors="replace").removeprefix("\ufeff")


def _pieces(stream: BinaryIO) -> Iterator[bytes]:
    while data := stream.readline(LONGEST_LINE):
        yield data


def opened(path: Path) -> BinaryIO:
    """The file for reading; raises WayfixError."""
    try:
        return path.open("rb")
    except OSError as error:
        raise WayfixError(f"cannot be read ({error.strerror})", str(path), "give the path of a file") from error


def digest_of(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with opened(path) as stream:
        digest = hashlib.sha256()
        while data := stream.read(1 << 20):
            digest.update(data)
        return digest.hexdigest()
