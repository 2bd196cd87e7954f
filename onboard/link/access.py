"""Access control of the link: by keys on an allow list, or open to everybody (`--open`).

On an open link nothing is encrypted, everybody reads and commands, and the daemon warns of it at each start.
"""

import asyncio
from typing import Final

import zmq

from common.keys import fingerprint
from onboard.journal import Journal
from onboard.link.allow_list import COMMAND, AllowList
from onboard.link.authenticator import Zap


class Access:
    """Who may do what. It exists before the socket that it guards, and is closed after it."""

    def __init__(
        self, context: "zmq.Context[zmq.Socket[bytes]]", allow_list: AllowList | None, journal: Journal
    ) -> None:
        """allow_list: `None` = an open link. The context is that of the link's socket."""
        self.allow_list: Final = allow_list
        self._journal = journal.child("link")
        self._zap = None if allow_list is None else Zap(context, allow_list, self._refused)

    @property
    def secret_key(self) -> bytes | None:
        """The board's own, Z85; `None` = nothing is encrypted."""
        return None if self.allow_list is None else self.allow_list.secret_key

    @property
    def public_key(self) -> str | None:
        """The board's own, Z85; `None` on an open link."""
        return None if self.allow_list is None else self.allow_list.public_key.decode("ascii")

    async def start(self) -> list[asyncio.Task[None]]:
        """Answer handshakes in the running loop; returns the tasks that do it.

        Call it before the link's socket is bound. Raises WayfixError when a stranger is not refused.
        """
        if self._zap is None:
            return []
        answering = asyncio.create_task(self._zap.run())
        await self._zap.self_test()
        return [answering]

    def opened(self, endpoint: str) -> None:
        """The link listens at `endpoint`: a warning (event `link-open`) where no key is asked for."""
        if self.allow_list is None:
            self._journal.tell("link-open", bind=endpoint)

    def rights(self, key: str | None) -> frozenset[str] | None:
        """What the sender with this public key (Z85) may do: `read`, `command`; `None` = it is not on the list.

        On an open link everybody may do both.
        """
        return COMMAND if self.allow_list is None else self.allow_list.rights_of(key)

    def name_of(self, key: str) -> str:
        """The name that the allow list has for a key; on an open link what the sender is called already."""
        return key if self.allow_list is None else self.allow_list.name_for(key)

    def close(self) -> None:
        """Close the socket of the handshakes."""
        if self._zap is not None:
            self._zap.close()

    def _refused(self, key: str) -> None:
        self._journal.tell("station-refused", fingerprint=fingerprint(key))
