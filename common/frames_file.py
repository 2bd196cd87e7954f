"""A frames file (docs/frames-file.md): the greeting of a session and its frames, one MessagePack value after another.

What `wayfix-onboard convert` writes and the station imports: byte for byte what travels over the link. Files of any
length are read frame by frame; one that was cut is read up to the cut.
"""

import os
import stat
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final, Self

import msgpack

from common import link_messages as session
from common.atomic_file import whole_file
from common.codec import MAX_FRAME_BYTES
from common.errors import CodecError, WayfixError
from common.versions import SCHEMA_VERSION, schema_fault

FILE_FORMAT: Final = 1
"""Version of the file format in the greeting's `file.format`; raised when an old reader could misread a new file."""
_CURE: Final = "give a file made by `wayfix-onboard convert`"
_HEAD_BYTES: Final = 16
_HEAD: Final = b"\xa4type\xa9connected"
"""Bytes that follow the first byte of every frames file."""


def is_frames_file(path: Path) -> bool:
    """Does it begin like a frames file? False for anything that cannot be read, too."""
    try:
        with path.open("rb") as stream:
            return stat.S_ISREG(os.fstat(stream.fileno()).st_mode) and _is_head(stream.read(_HEAD_BYTES))
    except OSError:
        return False


def write_frames_file(path: Path, greeting: dict[str, Any], frames: Iterable[bytes]) -> int:
    """Write a greeting (fields of `connected`) and encoded frames; how many frames there were.

    The file appears under its name when it is whole; whatever had that name is replaced then. Raises OSError,
    WayfixError for a greeting that no reader takes, and whatever `frames` raises; nothing is left behind in that case.
    """
    head = session.pack("connected", schema=SCHEMA_VERSION, **greeting)
    if len(head) > session.MAX_GREETING_BYTES:
        fault = (
            f"the boat's configuration takes {len(head)} bytes, more than the {session.MAX_GREETING_BYTES} of a file"
        )
        raise WayfixError(fault, str(path), "describe fewer sensors in one file")
    count = 0
    with whole_file(path) as stream:
        stream.write(head)
        for frame in frames:
            stream.write(frame)
            count += 1
    return count


@dataclass(frozen=True, slots=True)
class Cut:
    """The file ends in the middle of a value, or goes on with something else."""

    at_byte: int
    """Offset of the cut, bytes: everything before it was read."""
    lost_bytes: int
    reason: str

    def __str__(self) -> str:
        return f"{self.reason} at byte {self.at_byte}: {self.lost_bytes} bytes there are lost"


class FramesFile:
    """A frames file open for reading; a context. `cut` says after the last frame whether anything was left."""

    def __init__(self, path: Path) -> None:
        """Open the file and read its greeting. Raises WayfixError for what is no frames file of this schema."""
        self.path = path
        self.cut: Cut | None = None
        self._stream = _open(path)
        try:
            self.greeting = self._greeting()
        except BaseException:
            self._stream.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def frames(self) -> Iterator[bytes]:
        """Each frame's bytes in order, for `decode_frame`; a value that is no map ends the file like a cut."""
        values = self._values()
        next(values, None)  # the greeting
        yield from values

    def _values(self) -> Iterator[bytes]:
        self.cut = None
        self._stream.seek(0)
        size = os.fstat(self._stream.fileno()).st_size
        # Everything is skipped over here, nothing built: a value's own reader has its own limits.
        unpacker = msgpack.Unpacker(self._stream, max_buffer_size=MAX_FRAME_BYTES)
        start = 0
        while True:
            try:
                unpacker.skip()
            except msgpack.OutOfData:
                if start < size:
                    self.cut = Cut(start, size - start, "cut")
                return
            except Exception as error:  # msgpack raises its own errors and ValueError
                self.cut = Cut(start, size - start, f"damaged ({type(error).__name__})")
                return
            end = unpacker.tell()
            data = os.pread(self._stream.fileno(), end - start, start)
            if not _is_map(data):
                self.cut = Cut(start, size - start, "damaged (no map)")
                return
            yield data
            start = end

    def _greeting(self) -> dict[str, Any]:
        if not _is_head(self._stream.read(_HEAD_BYTES)):
            raise CodecError("is no frames file", str(self.path), _CURE)
        data = next(self._values(), None)
        if data is None:
            raise CodecError("is cut in its greeting", str(self.path), _CURE)
        try:
            greeting = session.unpack(data, session.MAX_GREETING_BYTES)
        except CodecError as error:
            raise CodecError(f"has no greeting ({error})", str(self.path), _CURE) from error
        fault = schema_fault(greeting.get("schema"))
        if fault is not None:
            raise CodecError(fault, str(self.path))
        made = greeting.get("file")
        if not isinstance(made, dict) or made.get("format") != FILE_FORMAT:
            raise CodecError("is a frames file of another format", str(self.path), "install the version that wrote it")
        return greeting


def _open(path: Path) -> BinaryIO:
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError as error:
        raise WayfixError(f"cannot be read ({error.strerror})", str(path), _CURE) from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise WayfixError("is no plain file", str(path), _CURE)
    return os.fdopen(descriptor, "rb")


def _is_head(data: bytes) -> bool:
    return _is_map(data) and _HEAD in data[1:]


def _is_map(data: bytes) -> bool:
    return bool(data) and (0x80 <= data[0] <= 0x8F or data[0] in (0xDE, 0xDF))
