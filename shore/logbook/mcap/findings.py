"""Findings of a walk over an MCAP file so far: losses, damage that costs nothing, and counts."""

from dataclasses import replace

from mcap.records import Schema

from shore.logbook.mcap.damage import Flaw, Loss


class Findings:
    """Filled in by the walk; complete after its last item."""

    def __init__(self, size: int) -> None:
        """size: length of the file, bytes."""
        self.size = size
        self.at = 0
        """Number of bytes walked over, for a progress bar."""
        self.losses: list[Loss] = []
        self.cut: Loss | None = None
        """What a log that was not closed lost at its end; `None` = nothing is known to be lost there."""
        self.flaws: list[Flaw] = []
        self.chunks = self.checked = 0
        """Number of sound chunks, and of those that have a checksum."""
        self.messages = 0
        """Number of sound records of channels."""
        self.schemas: dict[int, Schema] = {}
        """Schemas of the log that is being walked over, by their id."""
        self.profile = ""
        """Text in the head of the file that says how it is to be used."""

    def flaw(self, first_byte: int, end_byte: int, what: str) -> None:
        """Note damage that costs no record; neighbours of one kind are one."""
        last = self.flaws[-1] if self.flaws else None
        if last is not None and last.end_byte == first_byte and last.what == what:
            self.flaws[-1] = replace(last, end_byte=end_byte)
        else:
            self.flaws.append(Flaw(first_byte, end_byte, what))
