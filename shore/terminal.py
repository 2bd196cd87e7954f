"""Terminal output of the commands ashore: words to stderr, data to stdout, one line of JSON last; list of filters."""

import argparse
import json
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from common.command import printable
from common.errors import WayfixError
from common.words import did_you_mean


def say(line: str) -> None:
    """One line of words; a terminal that is gone or full never ends a run."""
    with suppress(OSError, ValueError):
        sys.stderr.write(f"{_shown(line)}\n")
        sys.stderr.flush()


def tell(line: str) -> None:
    """Print one line of data on stdout."""
    sys.stdout.write(f"{_shown(line)}\n")


def width_of_stderr() -> int | None:
    """Width of the terminal that words go to, characters; `None` = they go to a file or a pipe."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns or None
    except (OSError, ValueError):
        return None


def _shown(text: str) -> str:
    """Text in which names of files and words of foreign logs cannot steer the terminal."""
    return "\n".join(map(printable, text.split("\n")))


def finish(arguments: argparse.Namespace, summary: dict[str, Any]) -> None:
    """The last line of stdout, where `--json` asks for it."""
    if arguments.json:
        tell(json.dumps(summary))
        sys.stdout.flush()


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add `--json`."""
    parser.add_argument("--json", action="store_true", help="last line of stdout is one JSON object")


def filters_named(text: str) -> tuple[str, ...]:
    """`a,b,c` -> names, checked before anything is started."""
    from shore.navigation.filter_registry import REGISTRY

    names = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    for name in names or ("",):
        if name not in REGISTRY:
            near, known = did_you_mean(name, REGISTRY), ", ".join(REGISTRY)
            raise WayfixError(f"unknown filter {name!r}{near}", "--filters", f"use one or more of {known}")
    return names


@contextmanager
def every_end_is_ctrl_c() -> Iterator[None]:
    """SIGTERM and a closed terminal raise KeyboardInterrupt too inside the block, so that what is open is put away."""
    handled = (signal.SIGTERM, signal.SIGHUP)
    previous = {each: signal.signal(each, signal.default_int_handler) for each in handled}
    try:
        yield
    finally:
        for each, handler in previous.items():
            signal.signal(each, handler)
