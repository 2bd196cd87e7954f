"""Key management handlers of the control socket: pair, pair-outcome, pair-close, keys, revoke, reload."""

import asyncio
from collections.abc import Callable
from typing import Any

from common.errors import WayfixError
from common.keys import fingerprint
from onboard.control.socket import NAME, Handler, Lasting, text_of
from onboard.journal import Journal
from onboard.link.allow_list import AllowList
from onboard.link.pairing_port import PairingPort, Request


class KeyRequests:
    """Handlers over the allow list and the pairing port; `changed` is called when the list lost a station."""

    def __init__(
        self,
        allow_list: AllowList,
        port: PairingPort,
        journal: Journal,
        changed: Callable[[], None],
    ) -> None:
        self._allow_list = allow_list
        self._port = port
        self._journal = journal.child("link")
        self._changed = changed

    def handlers(self) -> dict[str, Handler | Lasting]:
        """The handlers, for `Control`."""
        return {
            "pair": self._pair,
            "pair-outcome": Lasting(self._pair_outcome, self._call_off),
            "pair-close": self._pair_close,
            "keys": self._keys,
            "revoke": self._revoke,
            "reload": self._reload,
        }

    async def reload(self) -> None:
        """Read the allow list again and tell what is wrong with it: at the start, on SIGHUP, on request."""
        await asyncio.to_thread(self._allow_list.reload)
        self.tell_faults()
        count = len(self._allow_list.entries)
        self._journal.tell("keys-read", count=count)
        self._changed()

    def tell_faults(self) -> None:
        """One event when the list, as it was last read, has faults."""
        if faults := self._allow_list.faults:
            file, count = str(self._allow_list.file), len(faults)
            self._journal.tell("keys-damaged", file=file, count=count, first=faults[0])

    async def _pair(self, fields: dict[str, Any]) -> dict[str, Any]:
        port, name, command = fields.get("port"), fields.get("name"), fields.get("command", False)
        if port is not None and (type(port) is not int or not 0 <= port <= 65_535):
            raise WayfixError("port must be a whole number from 0 to 65535", NAME)
        if type(command) is not bool or (name is not None and not isinstance(name, str)):
            raise WayfixError("command is true or false, name a text", NAME)
        opened = await self._port.open(Request(port, command, name))
        return {"code": opened.code, "port": opened.port, "seconds": opened.seconds}

    async def _pair_outcome(self, _fields: dict[str, Any]) -> dict[str, Any]:
        paired, text = await self._port.outcome()
        return {"paired": paired, "text": text}

    async def _pair_close(self, _fields: dict[str, Any]) -> dict[str, Any]:
        self._call_off()
        return {}

    def _call_off(self) -> None:
        self._port.close("it was called off")

    async def _keys(self, _fields: dict[str, Any]) -> dict[str, Any]:
        keys = [
            {
                "name": entry.name,
                "rights": sorted(entry.rights, reverse=True),
                "fingerprint": fingerprint(entry.key),
                "key": entry.key,
            }
            for entry in self._allow_list.entries
        ]
        own = self._allow_list.public_key.decode("ascii")
        return {"keys": keys, "faults": self._allow_list.faults, "own": {"key": own, "fingerprint": fingerprint(own)}}

    async def _revoke(self, fields: dict[str, Any]) -> dict[str, Any]:
        name = text_of(fields, "name")
        try:
            found = await asyncio.to_thread(self._allow_list.remove, name)
        finally:
            self._changed()
        if found:
            self._journal.tell("key-revoked", name=name)
        return {"revoked": found}

    async def _reload(self, _fields: dict[str, Any]) -> dict[str, Any]:
        await self.reload()
        return {"keys": len(self._allow_list.entries), "faults": self._allow_list.faults}
