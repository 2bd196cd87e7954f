"""Framing of a recording: its measurements become frames of a boat, by the framer of the boat's own daemon."""

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any, Final, NamedTuple

from common.boat_config import BoatConfig, BoatTable, FramesTable, PortTable, SensorTable
from common.events import event
from common.framer import Framer, Identity, ImuSample, Measurement, Utc
from common.messages import Frame
from common.settings import as_dict
from common.units import NS_PER_S
from common.versions import SCHEMA_VERSION
from shore.imports.record_times import JUMP_NS

EMPTY_NS: Final = 60 * NS_PER_S
"""A silence of up to this long becomes empty frames, ns; a longer one is a hole, as in `wayfix-onboard convert`."""
PORT: Final = "recorded"
LARGEST_UTC_NS: Final = 2**63 - 1


class Placed(NamedTuple):
    """A measurement on boat time, and what that clock says there."""

    measurement: Measurement
    shift_ns: int
    """Shift of the recording's own clock, ns: it reads boat time less this."""
    epoch: int


@dataclass(frozen=True, slots=True)
class RecordingClock:
    """What the recording's own clock is."""

    utc_source: str
    """One of `UTC_SOURCES`; `none` = the clock counts from any moment."""
    doubt_ns: int
    shift_ns: int = 0
    """Shift between boat time and UTC, ns: where the clock was right, UTC is boat time less this."""

    def utc(self, t_ns: int, shift_ns: int) -> Utc:
        """UTC of a boat time; none where the clock, which says `t_ns - shift_ns`, was more than a minute off."""
        utc_ns = t_ns - shift_ns
        is_off = abs(shift_ns - self.shift_ns) > JUMP_NS
        if self.utc_source == "none" or is_off or not 0 <= utc_ns <= LARGEST_UTC_NS:
            return Utc(None, None, "none")
        return Utc(utc_ns, self.doubt_ns, self.utc_source)


def survey(placed: Iterable[Placed]) -> dict[str, float | None]:
    """Measurements a second of each sensor while it speaks (ImuSamples count, silences beyond 10 s do not)."""
    counts: Counter[str] = Counter()
    active_ns: Counter[str] = Counter()
    newest: dict[str, int] = {}
    kinds: dict[str, type] = {}
    for measurement, _, _ in placed:
        sensor, t_ns = measurement.sensor, measurement.t_ns
        # A compass that gives heading, turn and attitude at once measures once.
        if kinds.setdefault(sensor, type(measurement)) is not type(measurement):
            continue
        step_ns = t_ns - newest.get(sensor, t_ns)
        counts[sensor] += 1
        active_ns[sensor] += max(0, min(step_ns, 10 * NS_PER_S))
        newest[sensor] = max(t_ns, newest.get(sensor, t_ns))
    return {
        sensor: float(f"{min(1000.0, max(0.01, (count - 1) * NS_PER_S / active_ns[sensor])):.3g}")
        if count > 1 and active_ns[sensor]
        else None
        for sensor, count in counts.items()
    }


def boat_config(boat: BoatTable, sensors: Iterable[SensorTable], given: BoatConfig | None) -> BoatConfig:
    """The configuration of the boat in the recording; what `given` says of a sensor or of the boat holds instead."""
    known = {(table.id, table.role): table for table in given.sensor} if given else {}
    tables = tuple(replace(known.get((table.id, table.role), table), port=PORT) for table in sensors)
    return BoatConfig(
        boat=given.boat if given else boat,
        port=(PortTable(name=PORT, path=PORT),),
        sensor=tables,
        frames=given.frames if given else FramesTable(),
    )


def greeting_of(config: BoatConfig, digest: str, made: dict[str, Any]) -> dict[str, Any]:
    """What the boat would have said at the beginning: identity from the file's digest, nothing random.

    made: facts of the import beside the digest, kept in `file`.
    """
    facts = json.dumps([as_dict(config), made], sort_keys=True)
    text = hashlib.sha256(f"{digest} {facts}".encode()).hexdigest()
    return {
        "type": "connected",
        "schema": SCHEMA_VERSION,
        "boat_id": config.boat.id,
        "boot_id": text[:16],
        "clock_id": text[16:48],
        "start_no": 1,
        "next_seq": 0,
        "clock_rate": 1.0,
        "config": as_dict(config),
        "versions": {"wayfix": version("wayfix")},
        "sensors": [{"id": table.id, "state": "delivering", "reason": None} for table in config.sensor],
        "file": {"sha256": digest, **made},
    }


def identity_of(greeting: dict[str, Any]) -> Identity:
    """The identity that all frames of the recording have."""
    return Identity(*(greeting[name] for name in ("boat_id", "boot_id", "clock_id", "start_no")))


def frames_of(
    placed: Iterable[Placed], config: BoatConfig, identity: Identity, clock: RecordingClock
) -> Iterator[Frame]:
    """Frames on whole multiples of the period, up to the last measurement; none for no measurement.

    `placed`: in the order of the recording; a measurement that comes late is in the frame in which it came.
    """
    period_ns = round(NS_PER_S / config.frames.rate_hz)
    framer: Framer | None = None
    tick_ns = heard_ns = shift_ns = epoch = 0
    for measurement, shift, now_epoch in placed:
        t_ns = measurement.t_ns
        if framer is None:
            tick_ns, heard_ns = (t_ns // period_ns + 1) * period_ns, t_ns
            imus = [table.id for table in config.with_role("imu")]
            framer = Framer(identity, imus, tick_ns - period_ns)
            shift_ns, epoch = shift, now_epoch
        while tick_ns <= t_ns:
            if tick_ns - heard_ns > EMPTY_NS and (missed := (t_ns - tick_ns) // period_ns):
                tick_ns += missed * period_ns
                framer.add(event("ticks-missed", tick_ns, "import", count=missed))
                heard_ns = t_ns
            yield framer.tick(tick_ns, clock.utc(framer.t0_ns, shift_ns), epoch, ())
            tick_ns += period_ns
        if now_epoch != epoch:
            step_s = round((shift_ns - shift) / NS_PER_S, 3)
            framer.add(event("clock-stepped", t_ns, "import", sensor=measurement.sensor, step_s=step_s))
        shift_ns, epoch, heard_ns = shift, now_epoch, max(heard_ns, t_ns)
        framer.add(measurement)
    if framer is not None:
        yield framer.tick(tick_ns, clock.utc(framer.t0_ns, shift_ns), epoch, ())


def count_of(measurement: Measurement) -> str:
    """The word under which a measurement is counted."""
    return "ImuSample" if isinstance(measurement, ImuSample) else type(measurement).__name__
