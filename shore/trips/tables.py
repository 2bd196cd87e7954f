"""Terminal tables and screens of `wayfix log`."""

import os
from collections.abc import Iterable, Iterator
from datetime import timedelta
from itertools import islice
from typing import Any, Final

from rich.console import Console, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from common.command import printable
from common.toml_text import toml_lines
from common.words import counted
from shore.logbook.arithmetic import VERSIONS, WORDS, arithmetic_of
from shore.logbook.holes import Holes
from shore.logbook.mcap.damage import AnotherLog, clock
from shore.trips.examine import Examination
from shore.trips.listing import FIRST_DATE_NS, Trip, day, number

PIPE_WIDTH: Final = 120
"""Width in characters where the output is no terminal and COLUMNS is not set."""
WIDE: Final = 110
"""Width in characters from which on `ls` needs one line for a trip."""
STYLES: Final = {"whole": "green", "closed": "green", "being written": "cyan", "cut": "yellow", "damaged": "red"}
_LOSSES_SHOWN: Final = 20
_UNITS: Final = ("B", "kB", "MB", "GB", "TB")
_LEVEL_STYLES: Final = {"warning": "yellow", "error": "red"}


class _Terminal(Console):
    """rich would end the program itself, with exit code 1, when who reads has had enough (`| head`)."""

    def on_broken_pipe(self) -> None:
        """Leave it to `run_command`."""
        raise BrokenPipeError


def show(parts: Iterable[RenderableType]) -> None:
    """Print on stdout."""
    console = _console()
    for part in parts:
        console.print(part)


def width_of_stdout() -> int:
    """Width of the output in characters."""
    return _console().width


def _console() -> Console:
    console = _Terminal(highlight=False, markup=False, emoji=False)
    if console.is_terminal or os.environ.get("COLUMNS"):
        return console
    return _Terminal(highlight=False, markup=False, emoji=False, width=PIPE_WIDTH)


def trips_table(trips: list[Trip], width: int) -> Iterator[RenderableType]:
    """`log ls`: one line for each trip, or two on a narrow terminal."""
    if not trips:
        yield "no logs here"
        return
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for heading in ("start, UTC", "length", "distance", "size", "state"):
        is_number = heading in ("length", "distance", "size")
        table.add_column(heading, no_wrap=True, justify="right" if is_number else "left")
    table.add_column("boat", no_wrap=True, overflow="ellipsis", max_width=14)
    if width >= WIDE:
        table.add_column("trip", overflow="fold", min_width=12)
        table.add_column("log", no_wrap=True, overflow="ellipsis")
    for trip in trips:
        table.add_row(*_trip_cells(trip)[: len(table.columns)])
    if width >= WIDE:
        yield table
        return
    lines = Console(width=width, highlight=False, markup=False, emoji=False).render_lines(table, pad=False)
    for row, line in zip([None, *trips], lines, strict=True):
        yield Text.assemble(*((part.text, part.style or "") for part in line))
        if row is not None:
            *_, words, name = _trip_cells(row)
            yield Padding(Text(f"{name}: {words}" if words else name, "dim"), (0, 0, 0, 2), expand=False)


def _trip_cells(trip: Trip) -> tuple[Any, ...]:
    name = printable(trip.path.name)
    if not trip.is_log:
        return "", "", "", size(trip.size) if trip.size else "", Text("no log", "dim"), "", trip.state, name
    summary = trip.summary
    return (
        day(summary.get("utc_ns")),
        duration(number(summary.get("seconds"))),
        distance(number(summary.get("distance_m"))),
        size(trip.size),
        Text(trip.state, STYLES.get(trip.state, "")),
        printable(str(summary.get("boat") or "")),
        printable(", ".join(str(summary[key]) for key in ("name", "place") if summary.get(key))),
        name,
    )


def verify_screen(result: Examination) -> Iterator[RenderableType]:
    """`log verify` of one log."""
    reader = result.reader
    yield Text.assemble(
        f"{printable(reader.path.name)}: ", (result.state, f"bold {STYLES[result.state]}"), _verdict(result)
    )
    for loss in reader.losses[:_LOSSES_SHOWN]:
        yield Padding(Text(f"lost: {loss}", "red"), (0, 0, 0, 2), expand=False)
    if len(reader.losses) > _LOSSES_SHOWN:
        yield Text(f"  and {len(reader.losses) - _LOSSES_SHOWN} more losses (--json names them all)", "red")
    for flaw in (*reader.flaws[:_LOSSES_SHOWN], *trip_flaw(result)):
        yield Padding(Text(str(flaw), "yellow"), (0, 0, 0, 2), expand=False)
    if len(reader.flaws) > _LOSSES_SHOWN:
        yield Text(f"  and {len(reader.flaws) - _LOSSES_SHOWN} more flaws (--json names them all)", "yellow")
    grid = _grid()
    unchecked = result.chunks - result.checked
    checked = "all with a checksum that holds" if not unchecked else f"{unchecked} of them without a checksum"
    grid.add_row("chunks", f"{result.chunks} sound, {checked}" if result.chunks else "none: records have no checksum")
    grid.add_row("frames", frames_text(result))
    grid.add_row("records", _counts(result))
    if result.not_understood:
        told = ", ".join(f"{count} of {printable(topic)}" for topic, count in sorted(result.not_understood.items()))
        grid.add_row("", Text(f"sound, but not of our form: {told}", "yellow"))
    yield Padding(grid, (0, 0, 0, 2), expand=False)


def trip_flaw(result: Examination) -> tuple[str, ...]:
    """Damage that only the content shows."""
    return ("the name and summary at the end are not those of the records",) if result.words_differ else ()


def _verdict(result: Examination) -> str:
    reader = result.reader
    if result.state == "being written":
        return ", read up to its last whole chunk" + (", with damage before that" if reader.losses else "")
    if result.state == "whole":
        return ", nothing is lost" if not any(result.holes) else ", no record of it is lost, but frames are not in it"
    if result.state == "cut":
        others = len(reader.losses) - 1
        more = f", and {counted(others, 'stretch', 'stretches')} before that" if others else ""
        what = f"what came after {_second(result.last_ns)}" if result.last_ns is not None else "all of it"
        return f", {what} is lost{more}"
    known = [loss.records for loss in reader.losses if loss.records is not None]
    if not reader.losses:
        is_alone = not any(isinstance(flaw, AnotherLog) for flaw in reader.flaws)
        return ", but no record is lost" if is_alone else ", another log stands behind it"
    if len(known) == len(reader.losses):
        return f", {counted(sum(known), 'record')} lost"
    return f", {counted(len(reader.losses), 'stretch', 'stretches')} lost"


def frames_text(result: Examination) -> str:
    """How many frames there are, how many are not here, and why."""
    told = result.holes.sentences() or ["none missing"]
    return "; ".join([str(result.census.count), *told]) if result.census.count else "none"


def _counts(result: Examination) -> str:
    return ", ".join(f"{printable(topic)} {count}" for topic, count in sorted(result.counts.items())) or "none"


def info_screen(result: Examination, *, with_config: bool) -> Iterator[RenderableType]:
    """Screen of `log info`."""
    summary = result.summary()
    grid = _grid()
    for label, text in _trip_rows(result, summary):
        grid.add_row(label, "\n".join(map(printable, text.split("\n"))) if isinstance(text, str) else text)
    yield grid
    start = result.starts[-1] if result.starts else {}
    config = _part(_part(start, "connected"), "config")
    if config.get("sensor"):
        yield Padding(_sensors(config), (1, 0, 0, 0))
    if result.warnings:
        yield Padding(_warnings(result), (1, 0, 0, 0))
    if with_config:
        yield ""
        yield from toml_lines(config)


def _trip_rows(result: Examination, summary: dict[str, Any]) -> Iterator[tuple[str, RenderableType]]:
    path = result.reader.path
    yield "log", f"{printable(path.name)}, {size(path.stat().st_size)}"
    yield "state", Text.assemble((result.state, STYLES[result.state]), _verdict(result))
    for loss in islice((*result.reader.losses, *result.reader.flaws), 3):
        yield "", Text(str(loss), "red" if loss in result.reader.losses else "yellow")
    if len(result.reader.losses) > 3:
        yield "", Text(printable(f"and more: wayfix log verify {path.name}"), "red")
    for key in ("name", "place", "note"):
        if summary.get(key):
            words = str(summary[key])
            yield ("trip" if key == "name" else key), words if key == "note" else printable(words)
    yield "boat", str(summary.get("boat") or "not known")
    if (start_ns := number(summary.get("utc_ns"), int)) is not None:
        end_ns = number(summary.get("end_utc_ns"), int)
        yield "time", f"{_second(start_ns)} to {_second(result.last_ns if end_ns is None else end_ns)}"
    yield "length", duration(number(summary.get("seconds")))
    yield "sailed", _sailed(summary, result.fixes_area)
    yield from _rests(result.trip.as_record())
    yield "frames", frames_text(result)
    end = _part({"end": result.last("end")}, "end")
    before = Holes(*(number(end.get(f"{word}_before"), int) or 0 for word in ("lacking", "lost")))
    yield from (("before", f"of earlier trips {hole}") for hole in before.sentences())
    yield "filters", ", ".join(map(str, summary.get("filters") or ())) or f"no estimates: {why_no_estimates(result)}"
    yield "events", ", ".join(f"{n} {level}" for level, n in _part(summary, "events").items()) or "none"
    start = result.starts[-1] if result.starts else {}
    if settings := _settings(_part(start, "options")):
        yield "settings", settings
    for label, versions in (("station", start.get("versions")), ("board", _part(start, "connected").get("versions"))):
        if isinstance(versions, dict) and versions:
            yield label, ", ".join(f"{name} {version}" for name, version in versions.items())
    if (arithmetic := arithmetic_of(start)) is not None:
        told = ", ".join(f"{word} {arithmetic[name]}" for name, word in WORDS.items() if name not in VERSIONS)
        yield "arithmetic", printable(told)
    recovered = result.last("recovered")
    if recovered:
        count = len(recovered.get("losses", ()))
        yield "recovered", f"from {recovered.get('from')}, which lost {counted(count, 'stretch', 'stretches')}"


def why_no_estimates(result: Examination) -> str:
    """Why a log holds none, in a sentence."""
    start = result.starts[-1] if result.starts else {}
    if not _part(start, "options").get("filters"):
        return "no filter was asked for"
    sensors = _part(_part(start, "connected"), "config").get("sensor") or ()
    return result.why_none.text({str(each.get("id")): str(each.get("role")) for each in sensors})


def _settings(options: dict[str, Any]) -> str:
    """What was set for the run, and by which file, or the command line."""
    tables = _part(options, "settings")
    values = {"filter": {"names": ",".join(map(str, options.get("filters") or ())), "step_s": options.get("step_s")}}
    told = []
    for key, source in _part(tables, "from").items():
        table, _, name = key.partition(".")
        value = _part(values | tables, table).get(name)
        told.append(f"{key} {'none' if value is None else value} ({source})")
    return ", ".join(told)


def _sailed(summary: dict[str, Any], fixes_area: tuple[float, float, float, float] | None) -> str:
    metres, area = number(summary.get("distance_m")), [number(summary.get(f"{edge}_deg")) for edge in _EDGES]
    if None in area:
        if fixes_area is None:
            return "no place is known"
        return f"no position was valid; the fixes are in {_sides(*fixes_area)}"
    speed = number(summary.get("max_sog_kn"))
    told = f"{distance(metres)}, up to {speed:.1f} kn" if speed is not None else distance(metres)
    return f"{told}, in {_sides(*area)}"


def _rests(computed: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """For how long position and heading rested on what, as the log's own estimates say; nothing of older logs."""
    longest_s = computed["longest_coasting_s"]
    words = {"fix": "on fixes", "coasting": f"coasting without a fix (longest {duration(longest_s)})"}
    words |= {
        "compass": "by compass",
        "course": "by the course over ground",
        "unknown": "not known",
        "not aligned": "not valid",
    }
    for part in ("position", "heading"):
        if times := computed[f"{part}_from_s"]:
            said = words | ({"coasting": "carried on without a compass"} if part == "heading" else {})
            most_first = sorted(times, key=times.__getitem__, reverse=True)
            yield part, ", ".join(f"{duration(times[word])} {said.get(word, word)}" for word in most_first)


def _sides(south: float, north: float, west: float, east: float) -> str:
    return f"{_degrees(south, 'SN')} to {_degrees(north, 'SN')}, {_degrees(west, 'WE')} to {_degrees(east, 'WE')}"


_EDGES: Final = ("south", "north", "west", "east")


def _degrees(value: float, sides: str) -> str:
    return f"{abs(value):.5f} {sides[value >= 0]}"


def _sensors(config: dict[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for heading in ("sensor", "role", "model", "rate", "port"):
        table.add_column(heading, no_wrap=True)
    for sensor in config["sensor"]:
        rate = number(sensor.get("rate_hz"))
        shown = f"{rate:g} Hz" if rate is not None else "as it comes"
        table.add_row(
            *(str(sensor.get(key, "")) for key in ("id", "role", "model")), shown, str(sensor.get("port", ""))
        )
    return table


def _warnings(result: Examination) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for heading in ("last warnings, UTC", "source", "what"):
        table.add_column(heading, no_wrap=heading != "what")
    for log_time_ns, event in result.warnings:
        style = _LEVEL_STYLES.get(event["level"], "")
        utc_ns = result.trip.utc.of(event["t_ns"]) if event["t_ns"] else None
        at = _second(log_time_ns if utc_ns is None else utc_ns)
        table.add_row(at.split()[-2][-8:], str(event["source"]), Text(str(event["text"]), style))
    return table


def _grid() -> Table:
    grid = Table.grid(padding=(0, 2, 0, 0))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column(overflow="fold")
    return grid


def _part(record: dict[str, Any], name: str) -> dict[str, Any]:
    value = record.get(name)
    return value if isinstance(value, dict) else {}


def _second(utc_ns: int | None) -> str:
    if utc_ns is not None and utc_ns < FIRST_DATE_NS:
        return f"unknown date {clock(utc_ns)[11:19]} UTC"
    return clock(utc_ns).replace(" UTC", "").split(".")[0] + " UTC" if utc_ns is not None else "?"


def duration(seconds: float | None) -> str:
    """1:02:03, or 0.4 s below a second."""
    if seconds is None or seconds < 0 or seconds >= 1e9:
        return "?"
    return f"{seconds:.1f} s" if 0 < seconds < 1 else str(timedelta(seconds=round(seconds)))


def distance(metres: float | None) -> str:
    """Metres, or kilometres from ten on."""
    if metres is None:
        return "?"
    return f"{metres:.0f} m" if metres < 10_000 else f"{metres / 1000:.1f} km"


def size(count: float) -> str:
    """Bytes for people."""
    unit = 0
    while count >= 1000 and unit < len(_UNITS) - 1:
        count, unit = count / 1000, unit + 1
    return f"{count:.0f} {_UNITS[unit]}" if unit == 0 or count >= 100 else f"{count:.1f} {_UNITS[unit]}"
