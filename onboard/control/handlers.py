"""Command handlers of the running daemon, for requests over the link or the control socket.

What changes something, or is asked by a station, is an event; what a person reads again and again (`raw`) is none.
"""

import json
from base64 import b64encode
from collections.abc import Callable, Mapping
from typing import Any, Final

from common.clock import boottime_ns
from common.errors import WayfixError
from onboard.control.socket import Handler, text_of
from onboard.journal import Journal
from onboard.link.client_leases import Pace

MAX_MARK = 200
TOLD_AT_ONCE: Final = 10
TOLD_PER_S: Final = 0.1
"""Rate limit of events that say `status` was asked for, a second: the right to read must not fill the journal."""


class Commands:
    """The commands `status`, `raw SENSOR PLACE`, `reopen SENSOR` and `mark TEXT`."""

    def __init__(
        self,
        status: Callable[[], dict[str, Any]],
        reopen: Mapping[str, Callable[[], None]],
        recent: Mapping[str, Callable[[int], tuple[bytes, int]]],
        journal: Journal,
    ) -> None:
        """reopen: for each sensor, the function that opens its port again.

        recent: for each sensor, what gives the bytes of its port from a place on, and the place behind them.
        """
        self._status = status
        self._reopen = reopen
        self._recent = recent
        self._journal = journal
        self._told = Pace(TOLD_AT_ONCE, TOLD_PER_S)

    async def from_link(self, name: str, argument: str, who: str) -> str:
        """A command of a station; returns the answer in words, raises WayfixError."""
        match name:
            case "status":
                if self._told.allows(boottime_ns()):
                    self._journal.child("link").tell("command-done", command=name, client=who)
                return json.dumps(self._status())
            case "raw":
                sensor, _, place = argument.partition(" ")
                return json.dumps(self.raw(sensor, place))
            case "reopen":
                return self.reopen(argument, who)
            case "mark":
                return self.mark(argument, who)
        raise WayfixError(f"there is no command {name!r}", "", "use status, raw SENSOR, reopen SENSOR or mark TEXT")

    def handlers(self) -> dict[str, Handler]:
        """For the control socket."""

        async def status(_fields: dict[str, Any]) -> dict[str, Any]:
            return self._status()

        async def reopen(fields: dict[str, Any]) -> dict[str, Any]:
            return {"text": self.reopen(text_of(fields, "sensor"), "this board")}

        async def mark(fields: dict[str, Any]) -> dict[str, Any]:
            return {"text": self.mark(text_of(fields, "text"), "this board")}

        async def raw(fields: dict[str, Any]) -> dict[str, Any]:
            return self.raw(text_of(fields, "sensor"), str(fields.get("place", "")))

        return {"status": status, "raw": raw, "reopen": reopen, "mark": mark}

    def raw(self, sensor: str, place: str) -> dict[str, Any]:
        """The bytes of a sensor's port from a place on ("" = the newest few), base64, and the next place."""
        self._check(sensor)
        data, behind = self._recent[sensor](int(place) if place.isdecimal() and len(place) < 20 else -1)
        return {"data": b64encode(data).decode("ascii"), "place": behind}

    def _check(self, sensor: str) -> None:
        if sensor not in self._reopen:
            raise WayfixError(f"there is no sensor {sensor[:32]!r}", "", f"use one of {', '.join(self._reopen)}")

    def reopen(self, sensor: str, who: str) -> str:
        """Open the port of a sensor again; raises WayfixError."""
        self._check(sensor)
        self._reopen[sensor]()
        self._journal.child(sensor).tell("command-done", command=f"reopen {sensor}", client=who)
        return f"the port of {sensor} is opened anew"

    def mark(self, text: str, who: str) -> str:
        """Put a remark into the frames, and so into every log; raises WayfixError."""
        if not text or not text.isprintable() or len(text) > MAX_MARK:
            raise WayfixError(f"a mark is 1 to {MAX_MARK} printable characters", "", "write it shorter, on one line")
        self._journal.child("operator").tell("mark", text=text, client=who)
        return "marked"
