"""`wayfix connect`: join a boat, which is looked for when no address is given."""

import argparse
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import TYPE_CHECKING, Final

from common.command import number
from common.errors import LinkError, WayfixError
from common.session import MAX_PERIOD_S, MAX_RUN_FRAMES, MIN_PERIOD_S
from shore.logbook.trip_arguments import add_trip_arguments
from shore.terminal import add_filter_arguments, add_json, filters_named, finish, say

if TYPE_CHECKING:
    from shore.boats import Boat, Boats
    from shore.finding import Candidate
    from shore.live import Options, Tally

DEFAULT_FILTERS: Final = "fuzzy"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Of `wayfix connect`."""
    parser.add_argument(
        "address",
        nargs="?",
        help="HOST or HOST:PORT of the boat, like 10.0.0.1:5760 (default: looked for where it was last met, at the "
        "gateway of this network, and by mDNS)",
    )
    parser.add_argument(
        "--frames",
        type=number(int, 1, MAX_RUN_FRAMES),
        metavar="M",
        help="receive exactly M frames, then end (the thesis' mode)",
    )
    parser.add_argument(
        "--period",
        type=number(float, MIN_PERIOD_S, MAX_PERIOD_S),
        metavar="SECONDS",
        help="length of a frame with --frames (default 1)",
    )
    parser.add_argument("--boat", metavar="ID", help="which of the paired boats (default: the one last met there)")
    parser.add_argument("--keys", type=Path, metavar="DIR", help="where keys are kept (default ~/.config/wayfix)")
    parser.add_argument("--open", action="store_true", help="no keys, for a boat whose daemon was started with --open")
    parser.add_argument("--log", type=Path, metavar="DIR", help="write a log into this directory")
    add_trip_arguments(parser)
    add_filter_arguments(parser, DEFAULT_FILTERS)
    add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Exit code 1 = fewer frames than asked for."""
    from shore.boats import Boats
    from shore.link import Link
    from shore.live import LiveRun, StopFlag

    options = _options(arguments)
    boats = Boats(arguments.keys)
    address, boat = _meet(arguments, boats)
    link = Link(address, keys=boats.link_keys(boat))
    if boat is None:
        say("OPEN LINK (--open): nothing is encrypted, and nobody knows whose boat this is")
    with StopFlag().on_signals() as stop:
        try:
            live = LiveRun(link, options, stop, say)
            if boat is not None:
                boats.remember(boat.boat_id, boat.public_key, address)
            tally = live.run()
        except LinkError:
            if stop():  # Ctrl-C while nobody had answered yet
                return 0
            raise
        finally:
            link.close()
    counts = {"received": tally.received, "missing": tally.missing}
    finish(arguments, {"frames": counts, "log": str(live.log_path) if live.log_path else None})
    return _exit_code(tally, options, is_stopped=stop())


def _options(arguments: argparse.Namespace) -> "Options":
    from shore.live import Options
    from shore.logbook.session import trip_record

    if arguments.period is not None and arguments.frames is None:
        raise WayfixError("--period needs --frames", cure="give --frames M too, or leave --period out")
    period_s = 1.0 if arguments.frames is not None and arguments.period is None else arguments.period
    filters = filters_named(arguments.filters)
    trip = trip_record(arguments.name, arguments.place, arguments.note)
    if trip is not None and arguments.log is None:
        raise WayfixError("a name, place or note is kept in a log", "--name", "give --log DIR too")
    return Options(filters, arguments.frames, period_s, arguments.step, arguments.log, trip)


def _exit_code(tally: "Tally", options: "Options", *, is_stopped: bool) -> int:
    if tally.end_reason is not None:
        say(f"the boat ended the session after {tally.sent} frames: {tally.end_reason}")
    if options.frames is not None and tally.received < options.frames and not is_stopped:
        say(f"only {tally.received} of {options.frames} frames were received")
        return 1
    return 0


def _meet(arguments: argparse.Namespace, boats: "Boats") -> tuple[str, "Boat | None"]:
    """Address and boat; None = a boat without keys. Raises WayfixError."""
    if arguments.address is not None:
        return arguments.address, None if arguments.open else boats.choose(arguments.address, arguments.boat)
    from shore.finding import find

    known: list[Boat] = [] if arguments.open else boats.meant(arguments.boat)
    say("looking for the boat" if arguments.open else f"looking for {', '.join(boat.boat_id for boat in known)}")
    met: dict[str, Boat | None] = {}

    def is_there(candidate: "Candidate", seconds: float) -> bool:
        met[candidate.address] = _who_answers(candidate.address, boats, [*known] or [None], seconds)
        return True

    found = find(known, is_there)
    boat = met[found.address]
    say(f"{'a boat' if boat is None else boat.boat_id} is at {found.address} ({found.how})")
    return found.address, boat


def _who_answers(address: str, boats: "Boats", tried: "list[Boat | None]", seconds: float) -> "Boat | None":
    """Which of these boats is there; raises LinkError.

    A board does not answer who greets it with another board's key, so each key is tried on a link of its own.
    """
    if len(tried) == 1:
        _greet(address, boats, tried[0], seconds)
        return tried[0]
    with ThreadPoolExecutor(len(tried)) as together:
        attempts = {together.submit(_greet, address, boats, boat, seconds): boat for boat in tried}
        for attempt in as_completed(attempts):
            if attempt.exception() is None:
                return attempts[attempt]
    raise next(iter(attempts)).exception() or LinkError("no answer", address)


def _greet(address: str, boats: "Boats", boat: "Boat | None", seconds: float) -> None:
    """Raises LinkError when this boat is not there."""
    from shore.link import Link

    link = Link(address, keys=boats.link_keys(boat))
    try:
        link.connect(seconds)
    finally:
        link.close()
