"""Settings of the station (configuration file, defaults, precedence): what `wayfix.toml` may hold, and how it is read.

    settings = station_settings(arguments.settings, arguments.filters, arguments.step)

A setting that changes estimates stands in [filter]: a log keeps it in its session record, where a replay takes it from.
"""

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Final

from common.command import printable
from common.errors import WayfixError
from common.field_bounds import OneOf, Range, SomeOnce
from common.messages import LEVELS
from common.settings import convert, load_toml
from shore.navigation.filter_registry import REGISTRY
from shore.navigation.fixed_steps import LONGEST_STEP_S, SHORTEST_STEP_S
from shore.settings.place import FILE, config_directory
from shore.terminal import filters_named

COMMAND_LINE: Final = "command line"


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """`[filter]`: how frames become estimates, in `connect` and `import`."""

    names: Annotated[tuple[Annotated[str, OneOf(tuple(REGISTRY))], ...], SomeOnce()] = ("fuzzy",)
    """Filters that run side by side, the first leads."""
    step_s: Annotated[float, Range(SHORTEST_STEP_S, LONGEST_STEP_S)] | None = None
    """Interval of synchronous steps, s (the thesis' Fig. 3.14); `None` = each measurement is fused at its own time."""


@dataclass(frozen=True, slots=True)
class LimitSettings:
    """`[limits]`: what is worth an alarm."""

    link_lost_s: Annotated[float, Range(1.5, 60.0)] = 3.0
    """Silence of the link after which a person is alarmed and the boat looked for elsewhere, s. Twice the link's
    watchdog, because one connection that had to be replaced is no news. No field case is on record."""
    log_behind_s: Annotated[float, Range(1.0, 600.0)] = 5.0
    """Duration of one sync of the log after which a person is warned, s."""
    estimate_stale_s: Annotated[float, Range(0.1, 600.0)] = 2.0
    """Age at which the status line marks an estimate as stale, s."""


@dataclass(frozen=True, slots=True)
class DisplaySettings:
    """`[display]`: what the terminal shows of a live run, and of a replay at a speed. The log holds all in any case."""

    status_line: bool = True
    """A status line each second."""
    events_from: Annotated[str, OneOf(LEVELS)] = "info"
    """Lowest level of the events that are said."""


@dataclass(frozen=True, slots=True)
class LogSettings:
    """`[log]`: what `connect` keeps."""

    directory: str = "logs"
    """Directory of the logs, from the working directory on; empty = no log is kept."""


@dataclass(frozen=True, slots=True)
class _Tables:
    """What a file may hold."""

    filter: FilterSettings = FilterSettings()
    limits: LimitSettings = LimitSettings()
    display: DisplaySettings = DisplaySettings()
    log: LogSettings = LogSettings()


@dataclass(frozen=True, slots=True)
class StationSettings:
    """What a command of the station runs with."""

    filter: FilterSettings = FilterSettings()
    limits: LimitSettings = LimitSettings()
    display: DisplaySettings = DisplaySettings()
    log: LogSettings = LogSettings()
    sources: Mapping[str, str] = field(default_factory=dict)
    """Where a value comes from, by its key (`limits.link_lost_s`): a file's name or `COMMAND_LINE`; else a default."""

    def as_options(self, *tables: str) -> dict[str, Any]:
        """Options of a session record: `filters` and `step_s` are what a replay takes, the rest is for people.

        tables: those that the run reads beside [filter].
        """
        beside = {name: asdict(getattr(self, name)) for name in tables}
        beside["from"] = {
            key: source for key, source in self.sources.items() if key.partition(".")[0] in ("filter", *tables)
        }
        return {"filters": list(self.filter.names), "step_s": self.filter.step_s, "settings": beside}


DEFAULTS: Final = StationSettings()
FRAMES_ONLY: Final = StationSettings(FilterSettings(names=()))
"""No filter runs; no file can ask for that."""


def settings_file(environ: Mapping[str, str]) -> Path | None:
    """The file that is read when none is named; `None` = this user has no home directory."""
    try:
        return config_directory(environ) / FILE
    except WayfixError:
        return None


def station_settings(
    file: Path | None,
    filters: str | None = None,
    step_s: float | None = None,
    log: str | None = None,
    *,
    environ: Mapping[str, str] = os.environ,
) -> StationSettings:
    """Settings of a command. Raises WayfixError with every fault of the file, or for an unknown filter.

    file: `--settings`, which must be there; `None` = `settings_file`, which need not. filters, step_s: the command
    line's, which win; a step of 0 is none at all. log: directory of the logs, which wins too; empty = none.
    """
    given = file if file is not None else settings_file(environ)
    settings = DEFAULTS
    if given is not None and (file is not None or _is_there(given)):
        settings = _read(given)
    if filters is not None:
        settings = _by_command_line(settings, "filter.names", filters_named(filters))
    if step_s is not None:
        settings = _by_command_line(settings, "filter.step_s", step_s or None)
    if log is not None:
        settings = _by_command_line(settings, "log.directory", log)
    return settings


def _is_there(path: Path) -> bool:
    """False when there is no such name; what cannot be looked at, or is a link to nothing, is there."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:
        pass
    return True


def _read(path: Path) -> StationSettings:
    data = load_toml(path)
    tables = convert(data, _Tables, str(path))
    keys = [f"{name}.{key}" for name, table in data.items() for key in table]
    name = printable(path.name)  # half a character would make the session record unreadable
    return StationSettings(tables.filter, tables.limits, tables.display, tables.log, dict.fromkeys(keys, name))


def _by_command_line(settings: StationSettings, key: str, value: Any) -> StationSettings:
    table, _, name = key.partition(".")
    changed: dict[str, Any] = {table: replace(getattr(settings, table), **{name: value})}
    return replace(settings, **changed, sources={**settings.sources, key: COMMAND_LINE})
