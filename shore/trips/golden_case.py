"""Regression tests (golden cases): a short log, what its replay must give, and in which arithmetic (tests/golden).

directory/log.mcap      the frames, byte for byte, and the session they came in
directory/expected.csv  one row every few seconds for each filter, with a digest: a change is read in the diff
directory/events.csv    the events of the replay
directory/case.toml     name, text, how it was made, filters, order, and the arithmetic that expected.csv comes from
"""

import argparse
import csv
import io
import shlex
import shutil
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from common.angles import difference_deg
from common.atomic_file import part_of
from common.command import printable
from common.errors import WayfixError
from common.toml_text import toml_text
from common.units import NS_PER_S
from common.words import counted
from shore.logbook.arithmetic import WORDS, Arithmetic, arithmetic_here, unlike
from shore.logbook.estimate_rounding import TOLERANCE, digest_of, heading_of

if TYPE_CHECKING:
    from shore.replay.frames import Span
    from shore.watchers.watcher import Step

LOG, EXPECTED, EVENTS, CASE = "log.mcap", "expected.csv", "events.csv", "case.toml"
EVERY_S: Final = 5.0
COLUMNS: Final = (
    "lat_deg", "lon_deg", "heading_true_deg", "sog_kn", "sigma_east_m", "sigma_north_m", "sigma_heading_deg",
)  # fmt: skip
"""Columns with numbers, and how they are written: one unit of the last decimal is `TOLERANCE`."""
DECIMALS: Final = 9
EVENT_COLUMNS: Final = ("t_s", "source", "code")
LOG_LIMIT: Final = 60_000
"""Most bytes of a log that may be kept in a repository."""

Row = dict[str, str]


@dataclass(frozen=True, slots=True)
class Case:
    """What `case.toml` says."""

    directory: Path
    name: str
    text: str
    made_by: str
    filters: tuple[str, ...]
    order: str
    every_s: float
    arithmetic: Arithmetic | None = None
    """Where the expectation was written; `None` before it was."""

    @property
    def other_arithmetic(self) -> str | None:
        """What is to be said of its arithmetic, without the subject; `None` = it is ours: every bit must be equal."""
        return unlike(self.arithmetic, arithmetic_here())


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `wayfix log case`."""
    from shore.replay.command import add_span
    from shore.terminal import add_json

    parser.add_argument("log", type=Path, help="any log")
    parser.add_argument("directory", type=Path, metavar="DIR", help="a new directory, named after the case")
    add_span(parser)
    parser.add_argument("--filters", help="comma-separated (default those of the live run)")
    parser.add_argument(
        "--order", choices=("arrival", "time"), default="arrival", help="of the replay (default arrival)"
    )
    parser.add_argument("--name", help="what is shown (default the directory's name)")
    parser.add_argument("--text", default="", help="what the case is for")
    add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Make a regression case of a log: its frames, and what a replay of them gives."""
    from shore.replay.command import span_of
    from shore.terminal import filters_named, finish, say, tell

    filters = filters_named(arguments.filters) if arguments.filters else ()
    name = _text(arguments.name, "--name") or printable(arguments.directory.name)
    _text(arguments.text, "--text")
    made_by = printable(f"wayfix log case {arguments.log.name} {arguments.directory.name}{_asked(arguments)}")
    case = Case(arguments.directory, name, arguments.text, made_by, filters, arguments.order, EVERY_S)
    sizes = write_case(arguments.log, case, span_of(arguments))
    told = ", ".join(f"{file} {size} bytes" for file, size in sizes.items())
    tell(printable(f"{arguments.directory}: {told}"))
    if sizes[LOG] > LOG_LIMIT:
        say(f"{LOG} is longer than {LOG_LIMIT} bytes: cut it with --from and --to before it goes into a repository")
    finish(arguments, {"case": str(arguments.directory), "bytes": sizes})
    return 0


def _text(given: str | None, option: str) -> str | None:
    """What was given; raises WayfixError for letters that no file in UTF-8 can hold."""
    try:
        (given or "").encode()
    except UnicodeEncodeError as error:
        raise WayfixError("is no UTF-8 text", option, "write it in a UTF-8 terminal") from error
    return given


def _asked(arguments: argparse.Namespace) -> str:
    given = {"from": arguments.from_s, "to": arguments.to_s, "filters": arguments.filters}
    given["order"] = None if arguments.order == "arrival" else arguments.order
    options = {
        name: value if isinstance(value, str) else f"{value:g}" for name, value in given.items() if value is not None
    }
    return "".join(f" --{name} {shlex.quote(value)}" for name, value in options.items())


def write_case(log: Path, case: Case, span: "Span | None" = None) -> dict[str, int]:
    """Make the directory of `case` from a part of a log; size of each file in bytes.

    Filters default to those of the live run. Raises: WayfixError when the directory exists, or the log holds no frame
    in the span.
    """
    directory = case.directory
    if directory.exists():
        raise WayfixError("exists already, a case is never overwritten", str(directory), "choose another name")
    part = part_of(directory)
    try:
        part.mkdir()
    except OSError as error:
        raise WayfixError(f"cannot be made ({error.strerror})", str(directory), "check name and rights") from error
    try:
        filters = _cut(log, part / LOG, case.filters, span)
        write_expected(replace(case, directory=part, filters=tuple(filters)))
        part.rename(directory)
    except OSError as error:
        raise WayfixError(f"cannot be written ({error.strerror})", str(directory), "check space and rights") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return {file: (directory / file).stat().st_size for file in (LOG, EXPECTED, EVENTS, CASE)}


def read_case(directory: Path) -> Case:
    """The case in a directory; raises WayfixError where there is none."""
    try:
        table = tomllib.loads((directory / CASE).read_text(encoding="utf-8"))
        return Case(
            directory, table["name"], table["text"], table["made_by"], tuple(table["filters"]), table["order"],
            float(table["every_s"]), _arithmetic(table.get("arithmetic")),
        )  # fmt: skip
    except (OSError, KeyError, ValueError) as error:
        raise WayfixError(f"holds no regression case ({error})", str(directory), "make one: wayfix log case") from error


def _arithmetic(table: dict[str, Any] | None) -> Arithmetic | None:
    return None if table is None else {name: str(table[name]) for name in WORDS}


def write_expected(case: Case) -> None:
    """Replay the case and write what it gives now, and in which arithmetic, over what was expected."""
    for file, text in (*replayed(case).items(), (CASE, _toml(case))):
        (case.directory / file).write_text(text, encoding="utf-8")


def replayed(case: Case) -> dict[str, str]:
    """What the replay gives now, as the texts of both CSV files."""
    from shore.replay.run import Replay

    rows: list[Row] = []
    told: list[Row] = []
    sampler = Sampler(case.every_s)
    for step in Replay(case.directory / LOG, case.filters, order=case.order):
        rows += sampler.rows(step)
        for event in step.output.events:
            t_s = step.t_s + (event.t_ns - step.frame.t1_ns) / NS_PER_S
            told.append({"t_s": f"{t_s:.3f}", "source": event.source, "code": event.code})
    return {EXPECTED: _csv(("t_s", "filter", "aligned", *COLUMNS, "digest"), rows), EVENTS: _csv(EVENT_COLUMNS, told)}


class Sampler:
    """Takes one estimate of each filter every so many seconds."""

    def __init__(self, every_s: float) -> None:
        self._every_s = every_s
        self._next_s: dict[str, float] = {}

    def rows(self, step: "Step") -> Iterator[Row]:
        """Rows of the estimates that belong to one frame."""
        for record in step.records:
            name, t_s = record["filter"], step.t_s + (record["t_ns"] - step.frame.t1_ns) / NS_PER_S
            if t_s < self._next_s.get(name, 0.0) - 1e-6:
                continue
            self._next_s[name] = (t_s // self._every_s + 1.0) * self._every_s
            shown = {**record, "heading_true_deg": heading_of(record)}  # whatever its doubt
            values = {column: f"{shown[column]:.{DECIMALS}f}" for column in COLUMNS}
            aligned = str(int(record["aligned"]))
            yield {"t_s": f"{t_s:.3f}", "filter": name, "aligned": aligned, **values, "digest": digest_of(record)}


def differences(case: Case) -> list[str]:
    """What is not as expected, a sentence each: any bit in the same arithmetic, more than `TOLERANCE` in another."""
    found: list[str] = []
    is_as_expected = _is_near if case.other_arithmetic else _is_equal
    for file, text in replayed(case).items():
        now = list(csv.DictReader(io.StringIO(text)))
        with (case.directory / file).open(newline="", encoding="utf-8") as stream:
            expected = list(csv.DictReader(stream))
        if len(now) != len(expected):
            found.append(f"{file}: {counted(len(now), 'row')}, {len(expected)} expected")
        for line, (ours, theirs) in enumerate(zip(now, expected, strict=False), 2):
            found += [
                f"{file}, line {line}, {column}: {ours[column]}, expected {value}"
                for column, value in theirs.items()
                if not is_as_expected(column, ours.get(column, ""), value)
            ]
    return found


def _is_equal(_column: str, ours: str, theirs: str) -> bool:
    return ours == theirs


def _is_near(column: str, ours: str, theirs: str) -> bool:
    if column not in COLUMNS:
        return column == "digest" or ours == theirs
    a, b = float(ours), float(theirs)
    return round(abs(difference_deg(a, b) if column == "heading_true_deg" else a - b), DECIMALS) <= TOLERANCE


def _cut(log: Path, target: Path, filters: tuple[str, ...], span: "Span | None") -> list[str]:
    """Frames of the span and their sessions, nothing else; the filters to replay."""
    from shore.logbook.log_reader import read_log
    from shore.logbook.log_writer import log_at
    from shore.replay.frames import Frames
    from shore.watchers.watcher import Start

    frames = Frames(read_log(log), "arrival", span)
    asked: dict[str, Any] = {**frames.start.options}
    asked["filters"] = list(filters or asked.get("filters", ()))
    writer = log_at(target)
    start: Start | None = None
    for arrival in frames:
        if arrival.start is not start:
            start = arrival.start
            writer.write_session({**start.record, "options": asked}, arrival.log_time_ns)
        writer.write_frame(arrival.data, arrival.frame, arrival.log_time_ns)
    if start is None:
        writer.abandon()
        raise WayfixError("holds no frame there", str(log), "give another --from or --to")
    writer.close()
    return list(asked["filters"])


def _toml(case: Case) -> str:
    table: dict[str, Any] = {
        "name": case.name,
        "text": case.text,
        "made_by": case.made_by,
        "filters": list(case.filters),
        "order": case.order,
        "every_s": case.every_s,
        "arithmetic": arithmetic_here(),
    }
    return toml_text(table)


def _csv(columns: tuple[str, ...], rows: list[Row]) -> str:
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()
