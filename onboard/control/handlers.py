"""Command handlers of the running daemon, for requests over the link or the control socket; every one is an event."""

import json
from collections.abc import Callable, Mapping
from typing import Any

from common.errors import WayfixError
from onboard.control.socket import Handler, text_of
from onboard.journal import Journal

MAX_MARK = 200


class Commands:
    """The commands `status`, `reopen SENSOR` and `mark TEXT`."""

    def __init__(
        self,
        status: Callable[[], dict[str, Any]],
        reopen: Mapping[str, Callable[[], None]],
        journal: Journal,
    ) -> None:
        """reopen: for each sensor, the function that opens its port again."""
        self._status = status
        self._reopen = reopen
        self._journal = journal

    async def from_link(self, name: str, argument: str, who: str) -> str:
        """A command of a station; returns the answer in words, raises WayfixError."""
        match name:
            case "status":
                self._journal.child("link").tell("command-done", command=name, client=who)
                return json.dumps(self._status())
            case "reopen":
                return self.reopen(argument, who)
            case "mark":
                return self.mark(argument, who)
        raise WayfixError(f"there is no command {name!r}", "", "use status, reopen SENSOR or mark TEXT")

    def handlers(self) -> dict[str, Handler]:
        """For the control socket."""

        async def status(_fields: dict[str, Any]) -> dict[str, Any]:
            return self._status()

        async def reopen(fields: dict[str, Any]) -> dict[str, Any]:
            return {"text": self.reopen(text_of(fields, "sensor"), "this board")}

        async def mark(fields: dict[str, Any]) -> dict[str, Any]:
            return {"text": self.mark(text_of(fields, "text"), "this board")}

        return {"status": status, "reopen": reopen, "mark": mark}

    def reopen(self, sensor: str, who: str) -> str:
        """Open the port of a sensor again; raises WayfixError."""
        if sensor not in self._reopen:
            raise WayfixError(f"there is no sensor {sensor[:32]!r}", "", f"use one of {', '.join(self._reopen)}")
        self._reopen[sensor]()
        self._journal.child(sensor).tell("command-done", command=f"reopen {sensor}", client=who)
        return f"the port of {sensor} is opened anew"

    def mark(self, text: str, who: str) -> str:
        """Put a remark into the frames, and so into every log; raises WayfixError."""
        if not text or not text.isprintable() or len(text) > MAX_MARK:
            raise WayfixError(f"a mark is 1 to {MAX_MARK} printable characters", "", "write it shorter, on one line")
        self._journal.child("operator").tell("mark", text=text, client=who)
        return "marked"
