"""GPX parser: the track points of a file, one after the other (XML by expat; a document type is refused).

Without a document type there are no entities, and so none that grow (billion laughs) or reach other files.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple
from xml.parsers import expat

from common.errors import WayfixError

DEEPEST: Final = 40
"""Deepest nesting of elements; GPX with extensions has ten."""
_LONGEST_TEXT: Final = 100
_CHUNK: Final = 1 << 16
_OF_POINT: Final = ("time", "ele", "speed", "course", "fix", "magvar")


class GpxPoint(NamedTuple):
    """A `trkpt` as it is written; missing is `None`."""

    line: int
    lat: str | None
    lon: str | None
    time: str | None = None
    ele: str | None = None
    """Height above mean sea level, m."""
    speed: str | None = None
    """Speed over ground, m/s (GPX 1.0, or an extension of Garmin and others)."""
    course: str | None = None
    fix: str | None = None
    """How good the fix was: none, 2d, 3d, dgps, pps."""


@dataclass(slots=True)
class GpxPoints:
    """The points of a file, read as they are needed."""

    path: Path
    progress: Callable[[int], None] | None = None
    skipped: dict[str, int] = field(default_factory=dict)
    """Number of points of other kinds: waypoints, points of routes."""
    cut: str | None = None
    """What is wrong with the file's end; `None` = it is whole. Known after the last point."""

    def __iter__(self) -> Iterator[GpxPoint]:
        """The points in the order of the file. Raises WayfixError for what is no GPX."""
        parser = _Parser(self)
        try:
            with self.path.open("rb") as stream:
                while data := stream.read(_CHUNK):
                    if self.progress:
                        self.progress(len(data))
                    parser.feed(data)
                    yield from parser.taken()
                parser.end()
        except OSError as error:
            where = str(self.path)
            raise WayfixError(f"cannot be read ({error.strerror})", where, "give the path of a file") from error
        except expat.ExpatError as error:
            yield from parser.taken()
            if not parser.has_root:
                raise WayfixError(f"is no GPX ({error})", str(self.path), "give a GPX file") from error
            self.cut = f"damaged or cut off ({error})"


class _Parser:
    """What expat calls."""

    def __init__(self, points: GpxPoints) -> None:
        self._points = points
        self._expat = expat.ParserCreate(namespace_separator=" ")
        self._expat.StartElementHandler = self._start
        self._expat.EndElementHandler = self._end
        self._expat.CharacterDataHandler = self._text
        self._expat.StartDoctypeDeclHandler = self._refuse
        self._path: list[str] = []
        self._place: tuple[str | None, str | None] | None = None
        self._line = 0
        self._values: dict[str, str] = {}
        self._words = ""
        self._taken: list[GpxPoint] = []
        self.has_root = False

    def feed(self, data: bytes) -> None:
        self._expat.Parse(data, False)

    def end(self) -> None:
        self._expat.Parse(b"", True)

    def taken(self) -> list[GpxPoint]:
        """The points since the last call."""
        taken, self._taken = self._taken, []
        return taken

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(" ")[2]
        if not self._path:
            if name != "gpx":
                raise self._refusal(f"is no GPX: its root is <{name[:20]}>", "give a GPX file")
            self.has_root = True
        self._path.append(name)
        if len(self._path) > DEEPEST:
            raise self._refusal(f"nests its elements deeper than {DEEPEST}", "this is no track")
        self._words = ""
        if name == "trkpt":
            self._place = attributes.get("lat"), attributes.get("lon")
            self._line = self._expat.CurrentLineNumber
            self._values = {}
        elif name in ("wpt", "rtept"):
            self._points.skipped[name] = self._points.skipped.get(name, 0) + 1

    def _text(self, text: str) -> None:
        if len(self._words) < _LONGEST_TEXT:
            self._words += text

    def _end(self, _: str) -> None:
        name = self._path.pop()
        if name == "trkpt" and self._place is not None:
            values = {key: self._values.get(key) for key in ("time", "ele", "speed", "course", "fix")}
            self._taken.append(GpxPoint(self._line, *self._place, **values))
            self._place = None
        elif self._place is not None and name in _OF_POINT and self._words.strip():
            self._values.setdefault(name, self._words.strip())
        self._words = ""

    def _refuse(self, *_: object) -> None:
        raise self._refusal("holds a document type (<!DOCTYPE>), which no GPX needs", "remove it from the file")

    def _refusal(self, what: str, cure: str) -> WayfixError:
        return WayfixError(what, f"{self._points.path}, line {self._expat.CurrentLineNumber}", cure)
