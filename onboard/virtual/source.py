"""Source interface of the virtual boat: one for voyages and recorded streams."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

from common.boat_config import BoatConfig
from onboard.virtual.baud_pacing import SerialLine


class Source(Protocol):
    """Lines for each of its ports, and the facts that the daemon needs about them."""

    bauds: Mapping[str, int]
    """Baud rate of each port, by its name."""
    counted: tuple[str, tuple[str, ...]]
    """Unit by which the sent lines are counted (`sensor` or `port`), and the names of all of them."""

    def head(self) -> str:
        """What boat.toml says of itself, after `Written by`."""
        ...

    def config(self, ports: Mapping[str, str], bind: str) -> BoatConfig:
        """The daemon's configuration for the ports (name -> path)."""
        ...

    def ready(self, directory: Path) -> dict[str, Any]:
        """What the line `ready` says beside ports and files."""
        ...

    def lines(self, start_ns: int, clock_rate: float) -> Mapping[str, Iterator[SerialLine]]:
        """Lines of each port in time order; t = 0 is boat time `start_ns`."""
        ...

    def started(self, directory: Path, start_ns: int) -> None:
        """The first line is due at boat time `start_ns`, half a second from now: write what had to wait for it."""
        ...

    def done(self, counts: Mapping[str, int]) -> dict[str, Any]:
        """What the line `done` says beside the counts of what was sent."""
        ...
