"""Choice of the boat and its address (discovery, rediscovery): the arguments that commands to a boat share."""

import argparse
import queue
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from common.clock import boottime_ns
from common.errors import LinkError, WayfixError
from common.units import NS_PER_S
from shore.terminal import say

if TYPE_CHECKING:
    from shore.link.discovery import Candidate
    from shore.link.known_boats import Boat, Boats
    from shore.link.link import Link

SEEK_PAUSE_S: Final = 5.0
"""Pause between two searches for a lost boat, s; a search lasts up to 5 s."""


def add_meeting_arguments(parser: argparse.ArgumentParser) -> None:
    """Address, boat and keys."""
    parser.add_argument(
        "address",
        nargs="?",
        help="HOST or HOST:PORT of the boat, like 10.0.0.1:5760 (default: looked for where it was last met, at the "
        "gateway of this network, and by mDNS)",
    )
    parser.add_argument("--boat", metavar="ID", help="which of the paired boats (default: the one last met there)")
    parser.add_argument("--keys", type=Path, metavar="DIR", help="where keys are kept (default ~/.config/wayfix)")
    parser.add_argument("--open", action="store_true", help="no keys, for a boat whose daemon was started with --open")


def link_to(address: str, boat: "Boat | None", boats: "Boats") -> "Link":
    """A link with the keys for this boat; an open one is shouted. Raises WayfixError."""
    from shore.link.link import Link

    if boat is None:
        say("OPEN LINK (--open): nothing is encrypted, and nobody knows whose boat this is")
    return Link(address, keys=boats.link_keys(boat))


def meet(arguments: argparse.Namespace, boats: "Boats") -> tuple[str, "Boat | None"]:
    """Address and boat, looked for where no address is given; None = a boat without keys. Raises WayfixError."""
    if arguments.address is not None:
        return arguments.address, None if arguments.open else boats.choose(arguments.address, arguments.boat)
    known: list[Boat] = [] if arguments.open else boats.meant(arguments.boat)
    if known:
        boats.link_keys(known[0])  # a fault in our own keys is reported once, not for each address
    say("looking for the boat" if arguments.open else f"looking for {', '.join(boat.boat_id for boat in known)}")
    found, boat = _look(known, boats)
    say(f"{'a boat' if boat is None else boat.boat_id} is at {found.address} ({found.how})")
    return found.address, boat


class Seeker:
    """Looks for a lost boat beside the run, once more each time it was not found."""

    def __init__(self, look: Callable[[], str], pause_s: float = SEEK_PAUSE_S) -> None:
        """look: as `looker` makes it; called in a thread of its own."""
        self._look = look
        self._pause_ns = round(pause_s * NS_PER_S)
        self._found: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._is_looking = False
        self._ended_ns = -self._pause_ns

    def ask(self) -> str | None:
        """The address that was found since the last question, once; begins a search when none is running."""
        found = None
        if self._is_looking:
            with suppress(queue.Empty):
                found = self._found.get_nowait()
                self._is_looking, self._ended_ns = False, boottime_ns()
        elif boottime_ns() - self._ended_ns >= self._pause_ns:
            self._is_looking = True
            threading.Thread(target=self._work, name="seeker", daemon=True).start()
        return found

    def _work(self) -> None:
        found = None
        try:
            with suppress(WayfixError):
                found = self._look()
        finally:
            self._found.put(found)


def looker(boat: "Boat", boats: "Boats") -> Callable[[], str]:
    """Finds the address where this boat is now and remembers it; raises WayfixError."""

    def look() -> str:
        found, _ = _look(boats.meant(boat.boat_id), boats)
        boats.remember(boat.boat_id, boat.public_key, found.address)
        return found.address

    return look


def _look(known: "list[Boat]", boats: "Boats") -> "tuple[Candidate, Boat | None]":
    """Address of one of these boats, and which boat it is (none known: any open one); raises LinkError."""
    from shore.link.discovery import find

    met: dict[str, Boat | None] = {}

    def is_there(candidate: "Candidate", seconds: float) -> bool:
        met[candidate.address] = _who_answers(candidate.address, boats, [*known] or [None], seconds)
        return True

    found = find(known, is_there)
    return found, met[found.address]


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
    """Greet this boat. Raises LinkError when it is not there."""
    from shore.link.link import Link

    link = Link(address, keys=boats.link_keys(boat))
    try:
        link.connect(seconds)
    finally:
        link.close()
