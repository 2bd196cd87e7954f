"""What a walk over an MCAP file has found so far: losses, damage that costs nothing, counts."""

from dataclasses import replace

from mcap.records import Schema

from shore.logbook.mcap.damage import Flaw, Loss


class Findings:
    """Filled in by the walk; complete after its last item."""

    def __init__(self, size: int) -> None:
        """size: bytes of the file."""
        self.size = size
        self.at = 0
        """Bytes walked over, for a progress bar."""
        self.losses: list[Loss] = []
        self.cut: Loss | None = None
        """What a log that was not closed lost at its end."""
        self.flaws: list[Flaw] = []
        self.chunks = self.checked = 0
        """Sound chunks; those with a checksum."""
        self.messages = 0
        """Sound records of channels."""
        self.schemas: dict[int, Schema] = {}
        """Of the log that is being walked over."""
        self.profile = ""
        """What the head of the file says of its use."""

    def flaw(self, first_byte: int, end_byte: int, what: str) -> None:
        """Note damage that costs no record; neighbours of one kind are one."""
        last = self.flaws[-1] if self.flaws else None
        if last is not None and last.end_byte == first_byte and last.what == what:
            self.flaws[-1] = replace(last, end_byte=end_byte)
        else:
            self.flaws.append(Flaw(first_byte, end_byte, what))
