"""File formats by name (format registry): which module writes each, and how a file of that kind begins."""

from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Final, NamedTuple

from common.errors import WayfixError
from common.words import did_you_mean, how_to_install


class Format(NamedTuple):
    """One value of `--to`."""

    module: str
    begins: Callable[[bytes], bool]
    """Is what begins like this a file of this kind, of ours? Only such a one is ever replaced.

    A Parquet file does not say at its beginning who wrote it.
    """
    is_table: bool = False
    """True when the format can fill a directory with several tables."""
    needs: str | None = None
    """Package that the format needs, which an extra installs; `None` = it needs none."""
    extra: str | None = None
    used_by: str | None = None
    """Program that such files are mostly for."""

    def writer(self) -> ModuleType:
        """Has `write(stream, track)`, and `write_all(streams, track)` when it is a table; both raise OSError."""
        return import_module(self.module)

    def check(self, name: str) -> None:
        """Raises WayfixError when a package is missing: before the long work begins."""
        if self.needs is not None:
            try:
                import_module(self.needs)
            except ModuleNotFoundError as error:
                what = f"{self.needs} is missing, which writes {name} files"
                raise WayfixError(what, cure=how_to_install(str(self.extra))) from error


_HERE: Final = "shore.exports"
HEAD: Final = 256
"""Number of bytes that `begins` wants to see."""
_XML: Final = b"<?xml"
FORMATS: Final[dict[str, Format]] = {
    "csv": Format(f"{_HERE}.csv_file", lambda head: head.startswith(b"t_s,utc,t_ns,"), is_table=True),
    "gpx": Format(
        f"{_HERE}.gpx", lambda head: head.startswith(_XML) and b'<gpx version="1.1" creator="wayfix"' in head
    ),
    "kml": Format(f"{_HERE}.kml", lambda head: head.startswith(_XML) and b"<!-- of wayfix export -->" in head),
    "geojson": Format(
        f"{_HERE}.geojson", lambda head: head.startswith(b'{"type": "FeatureCollection", "generator": "wayfix"')
    ),
    "nmea": Format(f"{_HERE}.nmea", lambda head: head.startswith(b"$IN")),
    "mcap": Format(
        f"{_HERE}.mcap_file",
        lambda head: head.startswith(b"\x89MCAP0") and b"wayfix-export" in head,
        used_by="Foxglove",
    ),
    "parquet": Format(
        f"{_HERE}.parquet", lambda head: head.startswith(b"PAR1"), is_table=True, needs="polars", extra="analysis"
    ),
    "png": Format(
        f"{_HERE}.png",
        lambda head: head.startswith(b"\x89PNG") and b"wayfix" in head,
        needs="matplotlib",
        extra="report",
    ),
}


_SUFFIXES: Final = {"json": "geojson", "nm": "nmea", "txt": "nmea", "log": "nmea"}
"""Other endings of file names -> format."""


def format_of(out: str) -> str:
    """The format that the ending of a file's name says. Raises WayfixError."""
    ending = out.rpartition("/")[2].rpartition(".")[2].lower()
    name = _SUFFIXES.get(ending, ending)
    if name not in FORMATS:
        what = f"the name says no format{did_you_mean(name, FORMATS)}"
        raise WayfixError(what, out, f"give it an ending, or --to with one of {', '.join(FORMATS)}")
    return name
