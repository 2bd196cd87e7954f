"""One filter over one recording: frames straight into the pipeline, scored against the recording's own truth.

Scored is from 10 s after the start on: the place while the filter waits for nothing but a heading, the heading while it
waits for nothing. `share` = share of the frames of that time for which it gave a valid place.
"""

import math
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Final
from unittest.mock import patch

import numpy as np

from benchmarks.boat_figures import Array
from benchmarks.scoring import Sums, sums_of
from common.boat_config import BoatConfig
from common.geodesy import LocalPlane
from common.messages import Fix, Frame
from common.simulation import without_ports
from common.simulation.motion import Truth
from common.simulation.voyage import Voyage
from common.simulation.without_ports import START_NS
from common.units import NS_PER_S
from shore.imports.job import ImportOptions, Job
from shore.imports.recognise import recognise
from shore.imports.run import imported
from shore.logbook.log_reader import read_log
from shore.navigation.estimate import Estimate
from shore.pipeline import Pipeline
from shore.replay.frames import Frames
from shore.report.reference import Reference, read_reference

SHARED: Final = Path(__file__).parents[2] / "shared"
"""Where the recordings and the cases lie: beside the repository."""
SETTLED_S: Final = 10.0
START_WORDS: Final = ("filter-started", "filter-waiting", "filter-aligned")
"""Events of every start, which say nothing here."""


@dataclass(frozen=True, slots=True)
class Sailed:
    """What one filter made of one or more runs; it adds up over them."""

    place: Sums = field(default_factory=Sums)
    heading: Sums = field(default_factory=Sums)
    frames: float = 0.0
    """Number of scored frames, with an estimate or without."""
    runs: int = 1
    events: tuple[tuple[str, float], ...] = ()
    """Code of each event that belongs to no start, and when it came, s."""

    def __add__(self, other: "Sailed") -> "Sailed":
        return Sailed(
            self.place + other.place,
            self.heading + other.heading,
            self.frames + other.frames,
            self.runs + other.runs,
            self.events + other.events,
        )

    def figure(self, name: str) -> float | None:
        """A figure of `Sums`, `share`, `shown_m` (2-D) or `shown_deg`; `None` = there was nothing to score."""
        if name == "share":
            return self.place.count / self.frames if self.frames else None
        sums = self.heading if name in {"heading_deg", "heading_e_s", "shown_deg"} else self.place
        if name == "raw_m":
            return math.sqrt(sums.raw / sums.fixes) if sums.fixes else None
        if not sums.count:
            return None
        if name == "shown_m":
            return math.sqrt(sums.position_shown / sums.count)
        if name == "shown_deg":
            return math.sqrt(sums.heading_shown / sums.count)
        return sums.figures()[name]

    def events_said(self) -> str:
        """Each code with the number of runs' worth of it and the median of its times."""
        codes = sorted({code for code, _ in self.events})
        times = {code: [t_s for each, t_s in self.events if each == code] for code in codes}
        return "; ".join(f"{code} {len(t)} in {self.runs} @ {np.median(t):.0f} s" for code, t in times.items())


@dataclass(frozen=True, slots=True)
class Course:
    """Where the frames of a run are scored: its truth and the boat time at which the truth's clock starts."""

    truth: Truth
    plane: LocalPlane
    start_ns: int = START_NS

    @property
    def seconds(self) -> float:
        """End of the truth on its own clock."""
        return float(self.truth.t_s[-1])


def sail_voyage(voyage: Voyage, name: str, near_fix_s: float | None = None) -> Sailed:
    """One filter on a voyage; near_fix_s: score only so soon after a fix. No latency, an epoch arrives at once."""
    with patch.object(without_ports, "EPOCH_S", 0.0):
        frames = list(without_ports.frames_of(voyage))
    parts = None if near_fix_s is None else {"": near_fix(frames, near_fix_s)}
    return sail(voyage.config, frames, name, Course(voyage.truth, voyage.plane), parts)[""]


def near_fix(frames: Sequence[Frame], seconds: float, least: int = 1) -> Callable[[int], bool]:
    """Were there so many usable fixes in the last `seconds` before a boat time?"""
    fixes_ns = np.sort([fix.t_ns for fix in usable_fixes(frames)])

    def is_near(t_ns: int) -> bool:
        first, last = np.searchsorted(fixes_ns, (t_ns - seconds * NS_PER_S, t_ns), side="right")
        return bool(last - first >= least)

    return is_near


def sail(
    config: BoatConfig,
    frames: Sequence[Frame],
    name: str,
    course: Course,
    parts: dict[str, Callable[[int], bool]] | None = None,
) -> dict[str, Sailed]:
    """One filter over frames, scored in parts, each named with the boat times that belong to it; "" = the whole.

    The events of each part are those of the whole.
    """
    pipeline = Pipeline(config, [name])
    estimates: list[Estimate] = []
    events: list[tuple[str, float]] = []
    for frame in frames:
        output = pipeline.push(frame)
        estimates += output.estimates
        events += [
            (event.code, (event.t_ns - course.start_ns) / NS_PER_S)
            for event in output.events
            if event.code not in START_WORDS
        ]
    return {
        part: _scored(frames, estimates, course, keep, tuple(events))
        for part, keep in (parts or {"": lambda _t_ns: True}).items()
    }


def _scored(
    frames: Sequence[Frame],
    estimates: Sequence[Estimate],
    course: Course,
    keep: Callable[[int], bool],
    events: tuple[tuple[str, float], ...],
) -> Sailed:
    raw = _raw(frames, course, keep)

    def sums(found: Sequence[Estimate]) -> Sums:
        kept = [item for item in found if keep(item.t_ns)]
        return sums_of(kept, course.truth, course.plane, raw, settled_s=SETTLED_S, start_ns=course.start_ns)

    first_ns = course.start_ns + SETTLED_S * NS_PER_S
    last_ns = course.start_ns + course.seconds * NS_PER_S
    placed = [item for item in estimates if all(words.startswith("heading") for words in item.waiting)]
    aligned = [item for item in placed if item.aligned]
    place = sums(placed)
    return Sailed(
        place=place,
        heading=place if len(aligned) == len(placed) else sums(aligned),
        frames=float(sum(first_ns <= frame.t1_ns <= last_ns and keep(frame.t1_ns) for frame in frames)),
        events=events,
    )


@cache
def imported_frames(source: Path, map_file: Path | None = None) -> tuple[BoatConfig, list[Frame]]:
    """The boat that `wayfix import` makes of a recording, and its frames."""
    with tempfile.TemporaryDirectory(prefix="wayfix-bench-") as folder:
        out = Path(folder) / "log.mcap"
        kind = recognise(source, has_map=map_file is not None, is_serial=False, is_alone=True)
        imported(Job(source, ImportOptions(map=map_file), kind), out)
        found = Frames(read_log(out))
        return found.start.config, [arrival.frame for arrival in found]


def usable_fixes(frames: Sequence[Frame]) -> list[Fix]:
    """All fixes that a filter may take."""
    return [fix for frame in frames for fix in frame.fixes if fix.usable]


def course_of_reference(file: Path, frames: Sequence[Frame]) -> Course:
    """The truth of a case, on the clock on which `wayfix replay --reference` reads it."""
    reference: Reference = read_reference(file, frames[0].t0_ns)
    heading = np.unwrap(np.radians(reference.heading_true_deg))
    t_s, east, north = reference.t_s, reference.east_m, reference.north_m
    truth = Truth(t_s, east, north, np.gradient(east, t_s), np.gradient(north, t_s), heading)
    return Course(truth, reference.plane, round(reference.start_ns))


def course_at_rest(frames: Sequence[Frame]) -> Course:
    """A receiver that lay still: at the median of its fixes all the time. Its heading is not known."""
    places = np.array([(fix.lat_deg, fix.lon_deg) for fix in usable_fixes(frames)], dtype=np.float64)
    lat_deg, lon_deg = np.median(places, axis=0).tolist()
    zero = np.zeros(2)
    t_s = np.array([0.0, (frames[-1].t1_ns - frames[0].t0_ns) / NS_PER_S])
    return Course(Truth(t_s, zero, zero, zero, zero, zero), LocalPlane(lat_deg, lon_deg), frames[0].t0_ns)


def course_of_fixes(frames: Sequence[Frame]) -> Course:
    """A recording of an RTK receiver is its own truth; velocity by differences over two epochs."""
    fixes = list({fix.t_ns: fix for fix in usable_fixes(frames)}.values())
    start_ns = frames[0].t0_ns
    plane = LocalPlane(fixes[0].lat_deg or 0.0, fixes[0].lon_deg or 0.0)
    t_s = np.array([(fix.t_ns - start_ns) / NS_PER_S for fix in fixes])
    east, north = places_of(fixes, plane).T
    headings = [(h.t_ns, h.heading_true_deg) for f in frames for h in f.headings if h.heading_true_deg is not None]
    times_ns, headings_deg = np.array(headings or [(start_ns, 0.0)]).T
    heading = np.interp(t_s, (times_ns - start_ns) / NS_PER_S, np.unwrap(np.radians(headings_deg)))
    return Course(Truth(t_s, east, north, np.gradient(east, t_s), np.gradient(north, t_s), heading), plane, start_ns)


def places_of(fixes: Sequence[Fix], plane: LocalPlane) -> Array:
    """East and north of usable fixes, m, (n, 2)."""
    return np.array([plane.to_east_north_m(fix.lat_deg or 0.0, fix.lon_deg or 0.0) for fix in fixes])


def _raw(frames: Sequence[Frame], course: Course, keep: Callable[[int], bool]) -> tuple[float, float]:
    """Sum of the squared errors of the fixes within the scored time, m^2, and their number."""
    scored = range(
        course.start_ns + round(SETTLED_S * NS_PER_S), course.start_ns + round(course.seconds * NS_PER_S) + 1
    )
    fixes = [fix for fix in usable_fixes(frames) if fix.t_ns in scored and keep(fix.t_ns)]
    if not fixes:
        return 0.0, 0.0
    seen = course.truth.at(np.array([(fix.t_ns - course.start_ns) / NS_PER_S for fix in fixes]))
    off = places_of(fixes, course.plane) - np.stack((seen.east_m, seen.north_m), axis=1)
    return float(np.sum(off**2)), float(len(fixes))


@dataclass(frozen=True, slots=True)
class Bench:
    """What a row needs."""

    pool: Executor
    draws: int
    filter: str
    hdop: float | None


Jobs = Sequence["Future[Sailed]"]
NOTHING: Final = Sailed()


def total(jobs: Jobs) -> tuple[Sailed, str]:
    """The sum over the runs that came to an end, and the words of the first that did not."""
    failed = [job.exception() for job in jobs if job.exception() is not None]
    done = [job.result() for job in jobs if job.exception() is None]
    words = "" if not failed else f"{len(failed)} of {len(jobs)} runs failed: {failed[0]!r}"
    return (sum(done[1:], done[0]) if done else NOTHING), words
