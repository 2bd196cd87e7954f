"""Part of a trip: one recording of several, its times on UTC, its measurements as a stream in order of arrival."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from common.boat_config import BoatTable, SensorTable
from common.errors import WayfixError
from common.framer import Measurement
from shore.imports.job import Job

ALONE = "import it alone, or leave it out"


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
    """Raises WayfixError for a recording of which more than a fifth could not be read.

    Fewer bad lines are nothing unusual; they are counted, as in an import of one file.
    """
    taken = sum(account.taken.total() for account in job.accounts)
    if not taken:
        raise WayfixError("nothing in it could be used", str(job.source), "leave it out")
    for account in job.accounts:
        rejected = account.rejected.total()
        if 5 * rejected > rejected + account.taken.total():
            reason, count = account.rejected.most_common(1)[0]
            what = f"is damaged: {rejected} of {account.total} {account.unit} could not be read ({reason}: {count})"
            raise WayfixError(what, str(job.source), ALONE)


def moved(measurement: Measurement, shift_ns: int) -> Measurement:
    """The measurement, `shift_ns` later on the clock; what it says of UTC stays."""
    return replace(measurement, t_ns=measurement.t_ns + shift_ns) if shift_ns else measurement
