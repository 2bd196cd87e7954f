"""`wayfix settings` (command line): the effective settings as TOML, each with its source."""

import argparse
import os
from collections.abc import Iterator
from dataclasses import fields
from typing import TYPE_CHECKING

from common.command import printable
from common.settings import as_dict
from common.toml_text import toml_lines
from shore.settings.arguments import add_filter_arguments, add_settings
from shore.terminal import add_json, finish, tell

if TYPE_CHECKING:
    from shore.settings.station import StationSettings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `wayfix settings`."""
    add_settings(parser)
    add_filter_arguments(parser, "those of the settings")
    add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the settings. Raises WayfixError with every fault of the file."""
    from shore.settings.station import COMMAND_LINE, settings_file, station_settings

    settings = station_settings(arguments.settings, arguments.filters, arguments.step)
    file = settings_file(os.environ) if arguments.settings is None else arguments.settings
    is_read = bool(set(settings.sources.values()) - {COMMAND_LINE})
    tell(f"# {file}" if is_read else f"# nothing is set in {file or 'a file: this user has no home directory'}")
    for line in lines_of(settings):
        tell(line)
    options = settings.as_options("limits", "display", "log")
    finish(arguments, {"file": printable(str(file)) if is_read else None, **options})
    return 0


def lines_of(settings: "StationSettings") -> Iterator[str]:
    """The settings as a file, with a comment for what a file cannot say."""
    for table in ("filter", "limits", "display", "log"):
        values = getattr(settings, table)
        yield ""
        yield f"[{table}]"
        for field in fields(values):
            source = settings.sources.get(f"{table}.{field.name}", "default")
            line = next(toml_lines({field.name: as_dict(getattr(values, field.name))}), f"# {field.name}: none")
            yield f"{line}  # {source}"
