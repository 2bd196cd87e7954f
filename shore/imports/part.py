"""Part of a trip: one recording of several, its times on UTC, its measurements as a stream in order of arrival."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from common.boat_config import BoatTable, SensorTable
from common.errors import WayfixError
from common.framer import Measurement
from shore.imports.job import Job
from shore.imports.reader import opened
from shore.imports.recognise import RecordingKind

ALONE: Final = "import it alone, or leave it out"
_TEXT: Final = bytes((*range(9, 14), *range(32, 127), *range(128, 256)))


@dataclass(frozen=True, slots=True, kw_only=True)
class TripPart:
    """What one recording brings."""

    job: Job
    boat: BoatTable
    sensors: tuple[SensorTable, ...]
    """Sensors that measured anything, by the recording's own names."""
    first_ns: int
    """UTC of the first record with a time, ns."""
    last_ns: int
    measurements: Callable[[], Iterator[Measurement]]
    """The measurements in the order in which they came, by the recording's own names; `t_ns` is UTC."""


def check_sound(job: Job) -> None:
    """Raises WayfixError for a recording of which more than a fifth could not be read, or a text with much else in it.

    Fewer bad lines are nothing unusual; they are counted, as in an import of one file.
    """
    if job.kind not in (RecordingKind.FRAMES, RecordingKind.LOG):
        strange, size = _strange_bytes(job.source)
        if 200 * strange > size:
            what = f"is damaged: {strange} of {size} bytes in it are control characters, which no text has"
            raise WayfixError(what, str(job.source), ALONE)
    taken = sum(account.taken.total() for account in job.accounts)
    if not taken:
        raise WayfixError("nothing in it could be used", str(job.source), "leave it out")
    for account in job.accounts:
        rejected = account.rejected.total()
        if 5 * rejected > rejected + account.taken.total():
            reason, count = account.rejected.most_common(1)[0]
            what = f"is damaged: {rejected} of {account.total} {account.unit} could not be read ({reason}: {count})"
            raise WayfixError(what, str(job.source), ALONE)


def _strange_bytes(path: Path) -> tuple[int, int]:
    """Number of control characters in a file, and of all bytes. A block that was lost holds zeros or anything."""
    strange = size = 0
    with opened(path) as stream:
        while data := stream.read(1 << 20):
            strange += len(data.translate(None, _TEXT))
            size += len(data)
    return strange, size


def moved(measurement: Measurement, shift_ns: int) -> Measurement:
    """The measurement, `shift_ns` later on the clock; what it says of UTC stays."""
    return replace(measurement, t_ns=measurement.t_ns + shift_ns) if shift_ns else measurement
