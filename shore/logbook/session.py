"""Session metadata: the records of `/session` that more than one writer makes."""

import platform
from importlib.metadata import version
from typing import Any, Final

from common.errors import WayfixError
from shore.logbook.arithmetic import arithmetic_here
from shore.logbook.summary import KEPT

LIBRARIES: Final = ("wayfix", "numpy", "msgpack", "mcap", "pygeomag")
"""Packages whose versions a replay depends on."""
LONGEST: Final = {"name": 200, "place": 200, "note": 2000}
"""Most characters of each text about a trip."""


def start_record(connected: dict[str, Any], options: dict[str, Any], utc_ns: int) -> dict[str, Any]:
    """What a log begins with.

    connected: the board's greeting, with its whole configuration (calibration included) and versions. options: at least
    `filters` and `step_s`. utc_ns: when it began. Versions and arithmetic are those of this process.
    """
    versions = {"python": platform.python_version(), **{name: version(name) for name in LIBRARIES}}
    arithmetic = {name: value for name, value in arithmetic_here().items() if name not in versions}
    return {
        "kind": "start",
        "options": options,
        "connected": connected,
        "versions": versions,
        "arithmetic": arithmetic,
        "utc_ns": utc_ns,
    }


def trip_record(name: str | None, place: str | None, note: str | None) -> dict[str, Any] | None:
    """What a person calls the trip; `None` when nothing is given. Raises WayfixError for what no screen can show."""
    words = dict(zip(KEPT, (name, place, note), strict=True))
    for key, value in words.items():
        _check(key, value or "")
    given = {key: value for key, value in words.items() if value}
    return {"kind": "trip", **given} if given else None


def _check(key: str, value: str) -> None:
    try:
        value.encode()
    except UnicodeEncodeError as error:
        raise WayfixError("is no UTF-8 text", f"--{key}", "write it in a UTF-8 terminal") from error
    if len(value) > LONGEST[key]:
        raise WayfixError(f"is {len(value)} letters long", f"--{key}", f"give {LONGEST[key]} at most")
    if any(not letter.isprintable() and letter != "\n" for letter in value):
        raise WayfixError("holds control characters", f"--{key}", "leave them out")
