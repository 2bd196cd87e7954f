"""Ring buffer of one port: its newest bytes as they came, to say what they are and to show them to people."""

from typing import Final

KEPT_BYTES: Final = 8_192
FEW_BYTES: Final = 1_024


class RecentBytes:
    """Newest bytes of a port. A place in the stream is the number of bytes before it since the daemon's start."""

    def __init__(self) -> None:
        self._kept = bytearray()
        self._end = 0

    def add(self, data: bytes) -> None:
        """Take what the port brought."""
        self._kept += data
        self._end += len(data)
        del self._kept[:-KEPT_BYTES]

    def clear(self) -> None:
        """Forget what came before: what is plugged in now may be another device."""
        self._kept.clear()

    def newest(self) -> bytes:
        """All that is kept."""
        return bytes(self._kept)

    def since(self, place: int) -> tuple[bytes, int]:
        """The bytes from a place on, or all that are kept of them, and the place behind them; -1 = the newest few."""
        missing = max(0, self._end - place) if place >= 0 else min(self._end, FEW_BYTES)
        return (bytes(self._kept[-missing:]) if missing else b""), self._end
