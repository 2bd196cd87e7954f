"""Import job: what was asked for (options), and what becomes of one recording (provenance record)."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shore.imports.line_counts import Account
from shore.imports.recognise import RecordingKind
from shore.settings.station import FRAMES_ONLY, StationSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """What an import was asked for."""

    settings: StationSettings = FRAMES_ONLY
    """Settings of the station; without a filter in them the log holds frames only."""
    trip: dict[str, Any] | None = None
    """Name, place and note of the trip (`trip_record`); `None` = none was given."""
    map: Path | None = None
    """Mapping file that says which column of a table is what; a table needs one."""
    config: Path | None = None
    """The boat's configuration file; `None` = the sensors are those found in the recording."""
    port: str | None = None
    """The `[[port]]` of `config` that a serial recording comes from."""
    vessel: str | None = None
    """The vessel whose Signal K deltas are read; `None` = the server's own."""
    lines_per_second: float | None = None
    """Pace of a recording without times, lines a second."""


@dataclass(slots=True)
class Job:
    """One recording on its way."""

    source: Path
    options: ImportOptions
    kind: RecordingKind
    accounts: tuple[Account, ...] = ()
    notes: list[str] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    """Facts that are kept in the log besides: the source of each sensor, gaps."""
    digest: str = ""

    def record(self) -> dict[str, Any]:
        """Record of the import for the log's `end` record and for the summary."""
        accounts = {account.unit: account.as_record() for account in self.accounts}
        made = {"file": self.source.name, "sha256": self.digest, "kind": str(self.kind)}
        return {**made, "accounts": accounts, "notes": self.notes, **self.facts}
