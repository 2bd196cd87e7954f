"""Command line of both programs: one sentence for every fault, exit codes, and number arguments with bounds.

Exit 0 = done (also after Ctrl-C), 1 = ran and the answer is no, 2 = wrong input or environment.
"""

import argparse
import json
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import TextIOWrapper
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from common.errors import SettingsError, WayfixError
from common.words import did_you_mean, how_to_install

N = TypeVar("N", int, float)


class Parser(argparse.ArgumentParser):
    """A parser, and those of its subcommands, that name the nearest of the known words."""

    def error(self, message: str) -> NoReturn:
        """Refuse the arguments, exit code 2."""
        wrong = re.search(r"invalid choice: '(?P<given>[^']*)' \(choose from (?P<known>.*)\)", message)
        known = [] if wrong is None else re.findall(r"[^\s,']+", wrong["known"])
        super().error(message + (did_you_mean(wrong["given"], known) if wrong else ""))


def run_command(program: str, extra: str, command: Callable[[], int]) -> int:
    """Run a command and turn what it raises into a sentence on stderr and an exit code.

    extra: the installation extra that brings the program's packages.
    """
    _open_closed()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # what the terminal's letters cannot show is shown by its number
            stream.reconfigure(errors="backslashreplace")
    try:
        code = command()
        sys.stdout.flush()
        return code
    except WayfixError as error:
        return _refuse(program, sentence_of(error))
    except KeyboardInterrupt:
        return 0
    except BrokenPipeError:  # `| head`: who reads has had enough
        _drop(1)
        return 0
    except ModuleNotFoundError as error:
        return _refuse(program, f"{error.name} is missing; {how_to_install(extra)}")
    except OSError as error:
        _drop(1)
        where = f" {error.filename}" if error.filename else ""
        return _refuse(program, printable(f"the system refuses{where} ({error.strerror}); check space and rights"))
    finally:
        try:
            sys.stderr.flush()
        except OSError:  # a terminal that is gone or full: the interpreter's end would make that exit code 120
            _drop(2)


def sentence_of(error: WayfixError) -> str:
    """One line for a terminal, or one for each fault of a settings file."""
    lines = str(error).split("\n") if isinstance(error, SettingsError) else [str(error)]
    return "\n".join(map(printable, lines))


def printable(text: str) -> str:
    """What a terminal may be given of a name: a line feed, ESC and the like by their number, as Python writes it."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def say_json(**fields: Any) -> None:
    """One JSON object as a line of stdout, at once; a reader that is gone by now is no fault."""
    with suppress(BrokenPipeError):
        sys.stdout.write(json.dumps(fields) + "\n")
        sys.stdout.flush()


def flat(told: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """(path, value) of everything inside maps, for people."""
    if isinstance(told, dict):
        for key, value in told.items():
            yield from flat(value, f"{name}.{key}" if name else str(key))
    else:
        yield name, told


def number(kind: type[N], low: N, high: N) -> Callable[[str], N]:
    """An argparse type: a number of this kind from `low` to `high`, with a sentence for anything else."""
    word = "a whole number" if kind is int else "a number"

    def parse(text: str) -> N:
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not low <= value <= high:
            raise argparse.ArgumentTypeError(f"must be {word} from {low} to {high}, got {text!r}")
        return value

    return parse


def _open_closed() -> None:
    """A program that is started with a closed stdout or stderr (`>&-`) has `None` there: write to nowhere instead.

    This also keeps the first file that is opened from getting the number of stdout.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 - open to the end


def _refuse(program: str, sentence: str) -> int:
    sys.stderr.write(f"{program}: {sentence}\n")
    return 2


def _drop(descriptor: int) -> None:
    """What is still buffered goes nowhere, instead of failing once more at the interpreter's end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)
