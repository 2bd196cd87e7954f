"""Parts of one log without their files: what is noted of them together, and how their streams are merged."""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from common.boat_config import BoatTable, SensorTable
from common.framer import Framer, Identity, ImuSample, Measurement, Utc
from common.messages import AisLine, Heading, TurnRate
from common.units import NS_PER_S
from shore.imports.framed_recording import measurements_of
from shore.imports.job import ImportOptions, Job
from shore.imports.part import TripPart
from shore.imports.recognise import RecordingKind
from shore.imports.several import Brought, merged, notes_of


def test_a_frame_is_unpacked_as_it_was_packed() -> None:
    identity = Identity("b", "0" * 16, "c", 1)
    framer = Framer(identity, ["imu1"], 0)
    late = Heading(sensor="compass1", t_ns=-(10**6), heading_true_deg=1.0)
    samples = [ImuSample("imu1", t_ns, 0.5, -0.25, 2.0) for t_ns in (10_000, 30_000, 50_000)]
    rates = [TurnRate(sensor="gyro1", t_ns=t_ns, rate_deg_s=3.0) for t_ns in (20_000, 40_000)]
    line = AisLine(sensor="ais1", t_ns=60_000, text="!AIVDM")
    measurements: list[Measurement] = [*rates, *samples, line, late]
    for measurement in measurements:
        framer.add(measurement)
    frame = framer.tick(10**8, Utc(None, None, "none"), 0, ())
    assert measurements_of(frame) == [late, samples[0], rates[0], samples[1], rates[1], samples[2], line]


def part_of(name: str, first_s: float, seconds: float, role: str = "gyro") -> TripPart:
    """A table whose measurements nobody asks for."""
    return TripPart(
        job=Job(Path(name), ImportOptions(), RecordingKind.TABLE),
        boat=BoatTable(id="b"),
        sensors=(SensorTable(id=f"{role}1", port="p", role=role),),
        first_ns=round(first_s * NS_PER_S),
        last_ns=round((first_s + seconds) * NS_PER_S),
        measurements=lambda: iter(()),
    )


def test_consecutive_serial_recordings_are_told_how_to_become_one() -> None:
    parts = [part_of("a", 0, 60), part_of("b", 66, 60)]
    assert [
        note for note in notes_of(parts, None) if note.startswith("b goes on after a with sensors of other numbers")
    ]
    for part in parts:
        part.job.kind = RecordingKind.SERIAL
    assert [note for note in notes_of(parts, None) if "`cat A B > C`" in note]
    assert not list(notes_of([parts[0], part_of("c", 66, 60, "gps")], None))


@pytest.mark.parametrize(
    ("first_s", "seconds", "suspected"),
    [
        (3600, 7200, True),
        (3640, 7190, True),
        (19_800 - 3600, 7200, False),  # does not overlap
        (3600, 3600, False),  # both ended together
        (1000, 7200, False),
        (10, 7200, False),
        (1800, 7200, True),
    ],
)
def test_a_clock_on_local_time_is_suspected(first_s: float, seconds: float, suspected: bool) -> None:
    notes = list(notes_of([part_of("utc", 0, 7200), part_of("local", first_s, seconds, "gps")], None))
    assert bool(notes) is suspected
    assert all(re.match("local begins and ends [01] h [03]0? min after utc", note) for note in notes)


def test_streams_are_merged_without_being_held() -> None:
    taken = Counter[str]()

    def readings(name: str, first_ns: int, step_ns: int) -> Iterator[Measurement]:
        for number in range(100_000_000):
            taken[name] += 1
            yield TurnRate(sensor=name, t_ns=first_ns + number * step_ns, rate_deg_s=0.0)

    steps = {"a": (0, 10), "b": (500, 1), "c": (3, 7)}
    parts = [replace(part_of(name, 0, 1), measurements=partial(readings, name, *step)) for name, step in steps.items()]
    brought = {place: Brought(0, 1, {name: name}) for place, name in enumerate("abc")}
    items = merged(parts, brought)
    times = [next(items).measurement.t_ns for _ in range(600)]
    assert times == sorted(times)
    assert taken.total() <= 600 + len(parts)
