"""Tally of a live run (frame accounting): what came, what is missing still, lost or not stored."""

from dataclasses import dataclass

from shore.logbook.holes import Holes


@dataclass(slots=True)
class Tally:
    """What became of the frames."""

    received: int = 0
    missing: int = 0
    """Number of frames that were asked for and are not here."""
    lost: int = 0
    """Number of frames that this run found to be lost: the boat does not hold them, or does not list them."""
    not_stored: int = 0
    """Number of frames that came when the log had ended."""
    repeated: int = 0
    """Number of frames that came once more and were left out."""
    bad: int = 0
    sent: int | None = None
    """Number of frames sent, as the board's `end` gives it; None = no end was received."""
    end_reason: str | None = None

    @property
    def holes(self) -> Holes:
        """What is not here, or not in the log, and why."""
        return Holes(self.missing, self.lost, self.not_stored)
