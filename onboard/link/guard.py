"""Access control of the link: keys on an allow list, or an open link on which every client reads and commands."""

import asyncio
from typing import Final

import zmq

from common.keys import fingerprint
from onboard.journal import Journal
from onboard.link.access import COMMAND, Access, Zap


class Guard:
    """Who may do what. It exists before the socket that it guards, and is closed after it."""

    def __init__(self, context: "zmq.Context[zmq.Socket[bytes]]", access: Access | None, journal: Journal) -> None:
        """Access: the allow list; `None` = an open link. The context is that of the link's socket."""
        self.access: Final = access
        self._journal = journal.child("link")
        self._zap = None if access is None else Zap(context, access, self._refused)

    @property
    def secret_key(self) -> bytes | None:
        """The board's own secret key, Z85; `None` = nothing is encrypted."""
        return None if self.access is None else self.access.secret_key

    @property
    def public_key(self) -> str | None:
        """The board's own public key, Z85; `None` on an open link."""
        return None if self.access is None else self.access.public_key.decode("ascii")

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
        """The link listens at `endpoint`: an event where no key is asked for."""
        if self.access is None:
            self._journal.tell("link-open", bind=endpoint)

    def rights(self, key: str | None) -> frozenset[str] | None:
        """What the sender with this public key (Z85) may do: `read`, `command`; `None` = it is not on the list."""
        return COMMAND if self.access is None else self.access.rights_of(key)

    def name_of(self, key: str) -> str:
        """The name that the allow list has for a key; on an open link what the sender is called already."""
        return key if self.access is None else self.access.name_for(key)

    def close(self) -> None:
        """Close the socket of the handshakes."""
        if self._zap is not None:
            self._zap.close()

    def _refused(self, key: str) -> None:
        self._journal.tell("station-refused", fingerprint=fingerprint(key))
