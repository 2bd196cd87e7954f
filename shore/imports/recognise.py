"""File type detection by content (magic numbers), never by name; one sentence says why a file cannot be imported."""

import json
import os
import re
import stat
from collections import Counter
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, NoReturn

from common.errors import WayfixError
from common.frames_file import is_frames_file
from common.framings import GNSS, frames_in
from shore.imports.csv_dialect import Table, example_of, table_in
from shore.imports.json_lines import one_object_a_line
from shore.imports.text_encoding import UTF16, decoded, encoding_of

HEAD_BYTES: Final = 1 << 18
"""Number of bytes at the beginning of a file that are enough to recognise it."""
MOST_NAMED: Final = 24
_EXAMPLES: Final = "examples are in deploy/examples"
_AS_UTF8: Final = "convert it with `iconv -f UTF-16 -t UTF-8 FILE > OUT`"
_KNOWN: Final = "NMEA 0183, gpsd JSON, Signal K, GPX and CSV with --map can be imported"


class RecordingKind(StrEnum):
    """What can be imported."""

    FRAMES = "frames file"
    SERIAL = "serial recording"
    TABLE = "table (CSV)"
    GPSD = "gpsd JSON"
    GPX = "GPX track"
    SIGNALK = "Signal K deltas"
    SIGNALK_LOG = "Signal K server log"
    LOG = "log"


_MAGICS: Final[tuple[tuple[bytes, str, str], ...]] = (
    (b"\x89HDF", "an HDF5 file (or MATLAB 7.3)", "export it as CSV and give a --map"),
    (b"MATLAB 5.0", "a MATLAB file", "export it as CSV and give a --map"),
    (b"\x89PNG", "a picture (PNG)", _KNOWN),
    (b"\xff\xd8\xff", "a picture (JPEG)", _KNOWN),
    (b"GIF8", "a picture (GIF)", _KNOWN),
    (b"%PDF", "a PDF", _KNOWN),
    (b"PK\x03\x04", "a ZIP archive or an office file", "unpack it, or save the sheet as CSV"),
    (b"\x1f\x8b", "compressed (gzip)", "unpack it with gunzip"),
    (b"BZh", "compressed (bzip2)", "unpack it with bunzip2"),
    (b"\xfd7zXZ", "compressed (xz)", "unpack it with unxz"),
    (b"\x28\xb5\x2f\xfd", "compressed (zstd)", "unpack it with unzstd"),
    (b"SQLite format 3", "an SQLite data base", "export the table as CSV and give a --map"),
    (b"PAR1", "a Parquet table", "export it as CSV and give a --map"),
    (b"#ROSBAG", "a ROS 1 bag", "export its topics as CSV and give a --map"),
    (b"\xa3\x95", "an ArduPilot flash log", "export its messages as CSV and give a --map"),
    (b"ULog", "a PX4 log", "export its messages as CSV (ulog2csv) and give a --map"),
    (b"\x7fELF", "a program", _KNOWN),
)
_EXPORTS: Final = {
    b'"generator": "wayfix"': "GeoJSON",
    b'creator="wayfix"': "GPX",
    b"of wayfix export": "KML",
    b"wayfix-export": "MCAP",
}
"""Bytes near the beginning of one of our own exports -> the format of that export."""
_MCAP: Final = b"\x89MCAP0\r\n"
_PACKETS_BYTES: Final = 1 << 14
"""Number of bytes of a binary file that are looked through for packets of known protocols."""
_SENTENCE: Final = re.compile(rb"[$!][A-Z0-9]{4,6},[^\r\n$!]*")
_OTHER_DEVICE: Final = re.compile(rb"!!!.*\*\*\*|\$C[0-9]+\.[0-9].*|%-?[0-9]{3}[0-9.].*")
"""Lines of an ArduIMU, a TCM2 or a KVH compass."""
SERVER_LINE: Final = re.compile(r"([0-9]{10,13}|[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9:.]+Z?);([^;]*);(.*)")
"""Line of a server's log: time (ms since 1970, or ISO 8601), provider, payload."""
_PROGRAM_LOG: Final = re.compile(rb"[0-9]{4}-[0-9]{2}-[0-9]{2} [0-9:,.]+ - [A-Z]+ - ")
_BEGINS_JSON: Final = re.compile(rb"\s*(\{|\[\s*([\[{\"0-9\]-]|$))")
"""Beginning of JSON, and not of TOML, whose tables are `[name]`."""
_JSON_KEY: Final = re.compile(r'"(\w+)"\s*:')


def recognise(path: Path, *, has_map: bool, is_serial: bool, is_alone: bool = True) -> RecordingKind:
    """The kind of a file; `is_serial`: the user says that it is a recording of a port (--config).

    is_alone: a log of ours is refused; beside other recordings it is one of them. Raises WayfixError for what cannot be
    imported, with what it looks like and what to do.
    """
    head = head_of(path)
    if not is_alone and _is_own_log(head):
        kind = RecordingKind.LOG
    else:
        kind = _kind(path, head, has_map=has_map, is_serial=is_serial)
    if kind is RecordingKind.TABLE and not has_map:
        table = table_in(head)
        assert table is not None
        _refuse_table(path, table)
    if kind is not RecordingKind.TABLE and has_map:
        raise WayfixError(f"is a {kind}, which needs no mapping", str(path), "import it without one")
    return kind


def _kind(path: Path, head: bytes, *, has_map: bool, is_serial: bool) -> RecordingKind:
    if is_frames_file(path):
        return RecordingKind.FRAMES
    _refuse_magic(path, head)
    is_utf16 = encoding_of(head) == UTF16
    # A logger that loses its power leaves zeros behind the text.
    head = decoded(head).encode() if is_utf16 else head.rstrip(b"\0")
    lines = [line for line in re.split(rb"[\r\n]+", head) if line.strip()]
    if not lines:
        raise WayfixError("there is nothing in it", str(path), "give a recording")
    found = _json_kind(path, lines)
    if found is not None:
        return found
    sentences = sum(_SENTENCE.search(line) is not None for line in lines)
    if 2 * sum(_is_server_line(line) for line in lines) > len(lines):
        return RecordingKind.SIGNALK_LOG
    if sentences > len(lines) // 100 or any(_OTHER_DEVICE.match(line) for line in lines[:100]):
        if is_utf16:
            raise WayfixError("is a serial recording in UTF-16", str(path), _AS_UTF8)
        return RecordingKind.SERIAL
    if _is_binary(head):
        packets, _ = frames_in(head[:_PACKETS_BYTES])
        if packets:
            framing = packets[0].framing
            cure = (
                f"{framing.cure}, or import what gpsd makes of it (gpspipe -w)"
                if framing.cure is GNSS
                else framing.cure
            )
            raise WayfixError(f"is binary ({framing.name})", str(path), cure)
        raise WayfixError("is binary, of a kind that is not known here", str(path), _KNOWN)
    if head.lstrip()[:1] == b"<" and b"<gpx" in head:
        return RecordingKind.GPX
    _refuse_text(path, head, lines)
    # The mapping may say what the table's head does not.
    if has_map or table_in(head) is not None:
        return RecordingKind.TABLE
    if is_serial:
        return RecordingKind.SERIAL
    raise WayfixError("is a text of a kind that is not known here", str(path), f"{_KNOWN}; with --config too")


def head_of(path: Path) -> bytes:
    """The first bytes of a file; raises WayfixError."""
    try:
        # Non-blocking: opening a pipe without a writer would wait for ever.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        with os.fdopen(descriptor, "rb") as stream:
            if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                raise WayfixError("is no plain file", str(path), "give a recording")
            return stream.read(HEAD_BYTES)
    except OSError as error:
        raise WayfixError(f"cannot be read ({error.strerror})", str(path), "give the path of a file") from error


def _refuse_magic(path: Path, head: bytes) -> None:
    for mark, name in _EXPORTS.items():
        if mark in head[:512]:
            cure = "use the log itself, or import its NMEA export (`wayfix export LOG --to nmea OUT`)"
            raise WayfixError(f"is a track of `wayfix export` ({name}), no recording of sensors", str(path), cure)
    if head.startswith(_MCAP):
        if _is_own_log(head):
            raise WayfixError(
                "is a log already", str(path), "`wayfix replay` runs it again, `wayfix log recover` mends it"
            )
        raise WayfixError("is an MCAP file of another program", str(path), f"export its topics as CSV; {_KNOWN}")
    for magic, name, cure in _MAGICS:
        if head.startswith(magic):
            raise WayfixError(f"is {name}", str(path), cure)


def _is_own_log(head: bytes) -> bool:
    # An export of ours is MCAP too; its mark stands further behind.
    return head.startswith(_MCAP) and b"wayfix" in head[:64] and b"wayfix-export" not in head[:512]


def _json_kind(path: Path, lines: list[bytes]) -> RecordingKind | None:
    """Kind of the file by the first lines that are JSON objects; `None` where there are none."""
    votes: Counter[RecordingKind] = Counter()
    for content in _objects(lines):
        if isinstance(content.get("updates"), list):
            votes[RecordingKind.SIGNALK] += 1
        elif isinstance(content.get("class"), str):
            votes[RecordingKind.GPSD] += 1
    if votes:
        return votes.most_common(1)[0][0]
    if _BEGINS_JSON.match(lines[0]) and not _SENTENCE.search(lines[0]):  # a time stamp may stand in brackets
        _refuse_json(path, b"\n".join(lines[:200])[:4096].decode(errors="replace"))
    return None


def _objects(lines: list[bytes]) -> Iterator[dict[str, Any]]:
    for line in one_object_a_line(line.decode(errors="replace") for line in lines):
        begin = line.find("{")
        if begin < 0 or line[0] in "$!#" or SERVER_LINE.match(line):
            continue
        try:
            content = json.loads(line[begin:])
        except (ValueError, RecursionError):
            continue
        if isinstance(content, dict):
            yield content


def _refuse_json(path: Path, text: str) -> NoReturn:
    keys = list(dict.fromkeys(_JSON_KEY.findall(text)))
    if "sensorID" in keys or "detections" in keys:
        what = "holds decoded detections of radar, lidar or cameras, not what a boat's own sensors said"
    elif "targetID" in keys:
        what = "holds the tracks of other vessels, not what a boat's own sensors said"
    elif "vessels" in keys:
        what = "is a Signal K tree: one moment, no recording"
    elif "FeatureCollection" in text or "coordinates" in keys:
        what = "is GeoJSON: a drawing without times"
    elif "updates" in keys or "class" in keys:
        cure = "put one object on each line, for example with `jq -c '.[]'`"
        raise WayfixError("is JSON that does not stand one object to a line", str(path), cure)
    else:
        what = f"is JSON of another kind (its keys: {', '.join(keys[:6]) or 'none'})"
    raise WayfixError(what, str(path), _KNOWN)


def _is_server_line(line: bytes) -> bool:
    """True for a sentence or a delta of a server's log, not for a table whose columns are parted by semicolons."""
    match = SERVER_LINE.match(line.decode(errors="replace"))
    if match is None or re.match(r"[+-]?[0-9.,]*(;|$)", match[3]):
        return False
    return re.search(r"[$!{,\\]", match[3]) is not None


def _is_binary(head: bytes) -> bool:
    strange = sum(byte < 9 or 13 < byte < 32 for byte in head)
    return 100 * head.count(0) > len(head) or 20 * strange > len(head)


def _refuse_text(path: Path, head: bytes, lines: list[bytes]) -> None:
    if head.lstrip()[:1] == b"<":
        name = "KML: a drawing" if b"<kml" in head else "XML or HTML"
        raise WayfixError(f"is {name}, no recording of sensors", str(path), f"convert it to CSV or GPX; {_KNOWN}")
    if sum(_PROGRAM_LOG.match(line) is not None for line in lines[:50]) * 2 > len(lines[:50]):
        cure = "write its values to a CSV with one time column and give a --map"
        raise WayfixError("is the text log of a program, with values inside sentences of its own", str(path), cure)


def _refuse_table(path: Path, table: Table) -> NoReturn:
    names = [name.lower() for name in table.columns]
    named = [name for name in table.columns if name]
    columns = ", ".join(named[:MOST_NAMED]) + (", ..." if len(named) > MOST_NAMED else "")
    if "mmsi" in names:
        cure = "import the boat's own NMEA stream, which carries AIS sentences too"
        raise WayfixError("holds decoded AIS positions of other ships, none of the boat's own", str(path), cure)
    if "scan" in names and not any("own" in name for name in names):
        raise WayfixError("holds decoded radar detections, nothing of the boat's own sensors", str(path), _KNOWN)
    example = example_of(table)
    cure = "say with --map MAP.toml, or FILE:MAP.toml, which column is what; " + (
        f"deploy/examples/{example} is for files with these columns" if example else _EXAMPLES
    )
    cure += "; `wayfix import --guess FILE` proposes one"
    raise WayfixError(f"is a table with the columns {columns}", str(path), cure)
