"""Honesty of the filters (RMS error, consistency) on recordings of real boats, beside what is asked of them.

    python -m benchmarks.honest_recordings [ROW ...] [--draws 12] [--filters fuzzy] [--workers 2] [--json] [--list]

The recordings and cases are read in `../shared`. in95 = share of time in which the 95 % ellipse shown holds the truth;
shown = the filter's own sigma (position 2-D), RMS; share = share of the frames with a valid place. Noise is drawn
`--draws` times, and figures are over all draws. An ask stands behind its figure; ok = all asks of the line hold.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from benchmarks import recorded_voyages as voyages
from benchmarks.asked import Figure, Line, median, notes, ratio
from benchmarks.recorded_runs import (
    Sailed,
    course_at_rest,
    course_of_fixes,
    course_of_reference,
    imported_frames,
    near_fix,
    sail,
    sail_voyage,
    usable_fixes,
)

SHARED: Final = Path(__file__).parents[2] / "shared"
DATA, CASES = SHARED / "data", SHARED / "cases" / "accuracy"
BLUEBOATS: Final = ("216", "218", "220", "224", "225", "228", "232", "235")
STILL: Final = (
    "radar-ttm-nmea/RadarLogs_lines_20001-40000.txt",
    "signalk-boat-nmea/gofree-merrimac.log",
    "gpsd-receivers/sirfstarv-nmea.log",
)
"""Moored boats with a compass, and a receiver that lies still, alone. None of them is under way."""
PEER_BLUEBOAT_M: Final = {"220": 0.82, "224": 0.87, "225": 0.80, "232": 0.81, "235": 0.83}
"""What the peer reached on the same recordings (position RMS, m)."""


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


def sail_ocean(file: Path, hdop: float | None, name: str, *, with_velocity: bool, seed: int) -> Sailed:
    return sail_voyage(voyages.ocean_voyage(file, seed, hdop, with_velocity=with_velocity), name)


def ocean(bench: Bench) -> Iterator[Line]:
    """RTK boats at sea, fixes 1 Hz + 3 m, own SOG/COG and heading, no IMU: with velocity beside without."""
    jobs = {
        file: [
            [
                bench.pool.submit(sail_ocean, file, bench.hdop, bench.filter, with_velocity=told, seed=seed)
                for seed in range(bench.draws)
            ]
            for told in (True, False)
        ]
        for file in sorted((DATA / "ocean-rtk-usv").glob("*.txt"))
    }
    ratios, velocities = [], []
    for file, (told, untold) in jobs.items():
        (with_it, failed), (without, _) = total(told), total(untold)
        quotient = ratio(with_it.figure("position_m"), without.figure("position_m"))
        velocity = with_it.figure("velocity_m_s")
        ratios.append(quotient)
        velocities.append(velocity)
        figures = (
            Figure("/without", quotient, most=0.50),
            Figure("vel_m_s", velocity, most=0.15),
            Figure("pos_m", with_it.figure("position_m")),
            Figure("in95", with_it.figure("in95")),
            Figure("alone_m", without.figure("position_m")),
            Figure("alone_in", without.figure("in95")),
            Figure("share", with_it.figure("share")),
        )
        yield Line(file.stem, figures, notes(failed, with_it.events_said()))
    yield Line(
        "median",
        (Figure("/without", median(ratios), most=0.45), Figure("vel_m_s", median(velocities), most=0.08)),
    )


def sail_blueboat(run: str, hdop: float | None, name: str, world: str, seed: int) -> Sailed:
    """World: healthy, no-imu, or a fault."""
    voyage = voyages.blueboat_voyage(_blueboat_file(run), seed, hdop)
    if world == "no-imu":
        voyage = voyages.without_imu(voyage)
    elif world != "healthy":
        voyage = voyages.with_fault(voyage, world)
    return sail_voyage(voyage, name)


def _blueboat_file(run: str) -> Path:
    return DATA / "blueboat-usv" / f"fixed_00000{run}.csv"


def _blueboat_jobs(bench: Bench, run: str, world: str) -> Jobs:
    sailing = partial(sail_blueboat, run, bench.hdop, bench.filter, world)
    return [bench.pool.submit(sailing, seed) for seed in range(bench.draws)]


def blueboat(bench: Bench) -> Iterator[Line]:
    """BlueBoat, fixes 1 Hz + 1.5 m and velocity + 0.15 m/s, IMU and compass of the recording."""
    jobs = {run: _blueboat_jobs(bench, run, "healthy") for run in BLUEBOATS}
    for run, each in jobs.items():
        sailed, failed = total(each)
        figures = (
            Figure("pos_m", sailed.figure("position_m"), most=0.95),
            Figure("vel_m_s", sailed.figure("velocity_m_s"), most=0.30),
            Figure("in95", sailed.figure("in95")),
            Figure("e/s", sailed.figure("position_e_s")),
            Figure("head_deg", sailed.figure("heading_deg")),
            Figure("shown_dg", sailed.figure("shown_deg")),
            Figure("share", sailed.figure("share")),
            Figure("peer_m", PEER_BLUEBOAT_M.get(run)),
        )
        yield Line(run, figures, notes(failed, sailed.events_said()))


def blueboat_faults(bench: Bench) -> Iterator[Line]:
    """The same with a fault in the IMU, beside the boat without IMU and the healthy one."""
    worlds = ("no-imu", "healthy", *voyages.FAULTS)
    jobs = {(run, world): _blueboat_jobs(bench, run, world) for run in BLUEBOATS for world in worlds}
    for run in BLUEBOATS:
        voyage = voyages.blueboat_voyage(_blueboat_file(run), 0, None)
        turned_s = voyages.first_turn_s(voyage.truth)
        said = "no turn of 20 deg" if turned_s is None else f"20 deg turned @ {turned_s:.0f} s"
        without, healthy = total(jobs[run, "no-imu"])[0], total(jobs[run, "healthy"])[0]
        for fault in voyages.FAULTS:
            sailed, failed = total(jobs[run, fault])
            wrong, right = sailed.figure("heading_deg"), healthy.figure("heading_deg")
            more = wrong - right if wrong is not None and right is not None else None
            figures = (
                Figure("/no-imu", ratio(sailed.figure("position_m"), without.figure("position_m")), most=1.10),
                Figure("more_deg", more, most=2.0),
                Figure("pos_m", sailed.figure("position_m")),
                Figure("in95", sailed.figure("in95")),
                Figure("shown_dg", sailed.figure("shown_deg")),
                Figure("share", sailed.figure("share")),
            )
            since = f"from {voyages.STUCK_FROM * voyage.seconds:.0f} s on" if fault == "stuck" else ""
            yield Line(f"{run} {fault}", figures, notes(failed, since, said, sailed.events_said() or "no event"))


def sail_still(file: Path, name: str) -> Sailed:
    config, frames = imported_frames(file)
    return sail(config, frames, name, course_at_rest(frames), {"": near_fix(frames, 10.0, least=8)})[""]


def usb(bench: Bench) -> Iterator[Line]:
    """Receivers at rest as `wayfix import` reads them: about the median of their fixes, holes left out."""
    jobs = {name: bench.pool.submit(sail_still, DATA / name, bench.filter) for name in STILL}
    for name, job in jobs.items():
        sailed, failed = total([job])
        figures = (
            Figure("in95", sailed.figure("in95"), least=0.80),
            Figure("pos_m", sailed.figure("position_m")),
            Figure("raw_m", sailed.figure("raw_m")),
            Figure("shown_m", sailed.figure("shown_m")),
            Figure("vel_m_s", sailed.figure("velocity_m_s")),
            Figure("share", sailed.figure("share"), least=0.95),
        )
        yield Line(Path(name).stem, figures, notes(failed, sailed.events_said()))


def sail_ferry(name: str, noise_m: float, seed: int) -> Sailed:
    return sail_voyage(voyages.ferry_voyage(DATA / "milliampere-ferry", seed, noise_m), name, near_fix_s=0.1)


def ferry(bench: Bench) -> Iterator[Line]:
    """RTK ferry at 0.1 m/s, at the fixes (1 Hz): with 0.01 m of noise, and as recorded."""
    for run, noise_m, draws in (("0.01 m", voyages.FERRY_SIGMA_M, bench.draws), ("as recorded", 0.0, 1)):
        sailing = partial(sail_ferry, bench.filter, noise_m)
        sailed, failed = total([bench.pool.submit(sailing, seed) for seed in range(draws)])
        quotient = ratio(sailed.figure("position_m"), sailed.figure("raw_m"))
        figures = (
            Figure("/raw", quotient, most=1.10 if noise_m else None),
            Figure("shown_m", sailed.figure("shown_m"), most=0.1),
            Figure("pos_m", sailed.figure("position_m")),
            Figure("raw_m", sailed.figure("raw_m")),
            Figure("in95", sailed.figure("in95")),
            Figure("vel_m_s", sailed.figure("velocity_m_s")),
            Figure("head_deg", sailed.figure("heading_deg")),
        )
        yield Line(run, figures, notes(failed, sailed.events_said()))


@dataclass(frozen=True, slots=True)
class Case:
    """What is right for a case, and what the peer reached."""

    asks: dict[str, dict[str, Any]]
    peer_m: float | None = None
    peer_deg: float | None = None


AT_MOST_2_DEG: Final = {"heading_deg": {"most": 2.0}}
RIGHT: Final = {
    "healthy": Case({"position_m": {"most": 1.5}, "heading_deg": {"most": 0.5}}, 0.60, 0.50),
    "imu-stuck-from-150s": Case({"position_m": {"most": 2.5}, **AT_MOST_2_DEG}, 0.59, 0.70),
    "imu-upside-down": Case(AT_MOST_2_DEG, 0.97, 120.0),
    "imu-all-zeros": Case(AT_MOST_2_DEG, 0.58, 0.81),
    "imu-turned-90deg": Case({"position_m": {"most": 1.8}}, 0.60, 0.52),
    "heel-in-turns-6ms": Case({"position_m": {"most": 1.5}}, 0.46, 0.51),
    "gps-correlated-tau120": Case({"in95": {"least": 0.90}, "velocity_m_s": {"most": 0.15}}, 1.42, 0.50),
    "no-compass-in-current": Case({"heading_e_s": {"most": 1.0, "may_lack": True}, "share": {"least": 0.95}}),
}
"""From the README of the cases; the bound of a boat without compass is the issue's."""
CASE_FIGURES: Final = {
    "position_m": "pos_m",
    "heading_deg": "head_deg",
    "in95": "in95",
    "shown_m": "shown_m",
    "velocity_m_s": "vel_m_s",
    "heading_e_s": "head_e/s",
    "shown_deg": "shown_dg",
    "share": "share",
}
"""Figures of a case, and what stands above them."""
RTK_PARTS: Final[dict[str, dict[str, dict[str, Any]]]] = {
    "RTK": {"shown_m": {"most": 0.1}},
    "single": {"shown_m": {"least": 2.0}},
    "RTK again": {},
}


def sail_case(case: str, name: str) -> Sailed:
    map_file = "map-no-compass.toml" if case.startswith("no-compass") else "map.toml"
    config, frames = imported_frames(CASES / f"{case}.csv", CASES / map_file)
    return sail(config, frames, name, course_of_reference(CASES / f"{case}-truth.csv", frames))[""]


def sail_rtk_single(name: str) -> dict[str, Sailed]:
    """Scored in parts: until the quality falls, while it is low, and from there on."""
    config, frames = imported_frames(CASES / "rtk-single-rtk.nmea")
    course = course_of_reference(CASES / "rtk-single-rtk-truth.csv", frames)
    single = [fix.t_ns for fix in usable_fixes(frames) if fix.fix_quality == 1]
    again = min(fix.t_ns for fix in usable_fixes(frames) if fix.t_ns > single[-1])
    parts = {
        "RTK": lambda t_ns: t_ns < single[0],
        "single": lambda t_ns: single[0] <= t_ns < again,
        "RTK again": lambda t_ns: t_ns >= again,
    }
    return sail(config, frames, name, course, parts)


def cases(bench: Bench) -> Iterator[Line]:
    """The cases of ../shared/cases/accuracy, imported with their map, beside what is right and the peer."""
    jobs = {case: bench.pool.submit(sail_case, case, bench.filter) for case in RIGHT}
    parts = bench.pool.submit(sail_rtk_single, bench.filter)
    for case, job in jobs.items():
        sailed, failed = total([job])
        right = RIGHT[case]
        figures = tuple(
            Figure(CASE_FIGURES[name], sailed.figure(name), **right.asks.get(name, {})) for name in CASE_FIGURES
        )
        peer = Figure("peer_m", right.peer_m), Figure("peer_deg", right.peer_deg)
        yield Line(case, (*figures, *peer), notes(failed, _first(sailed, right), sailed.events_said() or "no event"))
    failure = parts.exception()
    for part, asks in RTK_PARTS.items():
        sailed = NOTHING if failure else parts.result()[part]
        wanted = {"in95": {"least": 0.90}, **asks}
        figures = tuple(
            Figure(CASE_FIGURES[name], sailed.figure(name), **wanted.get(name, {})) for name in CASE_FIGURES
        )
        yield Line(f"rtk-single: {part}", figures, repr(failure) if failure else sailed.events_said() or "no event")


def _first(sailed: Sailed, right: Case) -> str:
    """Is it before the peer?"""
    pairs = (("position_m", right.peer_m), ("heading_deg", right.peer_deg))
    said = [
        f"{name.split('_')[0]} {'before' if value <= peer else 'behind'} peer"
        for name, peer in pairs
        if peer is not None and (value := sailed.figure(name)) is not None
    ]
    return ", ".join(said)


def sail_rtk(file: Path, name: str) -> Sailed:
    config, frames = imported_frames(file)
    return sail(config, frames, name, course_of_fixes(frames))[""]


def rtk_raw(bench: Bench) -> Iterator[Line]:
    """RTK boats at sea as recorded, 5 Hz, imported without a boat file: the doubt shown of an RTK fix."""
    files = sorted((DATA / "ocean-rtk-usv").glob("*.txt"))
    jobs = [bench.pool.submit(sail_rtk, file, bench.filter) for file in files]
    for file, job in zip(files, jobs, strict=True):
        sailed, failed = total([job])
        figures = (
            Figure("shown_m", sailed.figure("shown_m"), most=0.1),
            Figure("pos_m", sailed.figure("position_m")),
            Figure("e/s", sailed.figure("position_e_s")),
            Figure("in95", sailed.figure("in95"), least=0.90),
            Figure("vel_m_s", sailed.figure("velocity_m_s")),
            Figure("head_deg", sailed.figure("heading_deg")),
            Figure("share", sailed.figure("share")),
        )
        yield Line(file.stem, figures, notes(failed, sailed.events_said()))


ROWS: Final[dict[str, Callable[[Bench], Iterator[Line]]]] = {
    "ocean": ocean,
    "blueboat": blueboat,
    "blueboat-faults": blueboat_faults,
    "usb": usb,
    "ferry": ferry,
    "cases": cases,
    "rtk-raw": rtk_raw,
}


def main() -> None:
    """Print a line for each run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", nargs="*", metavar="ROW", help="left out = all; --list says what there is")
    parser.add_argument("--draws", type=int, default=12)
    parser.add_argument("--filters", default="fuzzy")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--hdop", type=float, help="HDOP that drawn fixes say (default: none, so that sigma_m holds)")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--list", action="store_true", help="say what the rows are, and end")
    arguments = parser.parse_args()
    if arguments.list:
        print("\n".join(f"{name:<16} {row.__doc__}" for name, row in ROWS.items()))
        return
    if unknown := [row for row in arguments.rows if row not in ROWS]:
        parser.error(f"no row {', '.join(unknown)}; there are {', '.join(ROWS)}")
    if not SHARED.exists():
        sys.exit(f"{SHARED} is not here: the recordings lie beside the repository")
    records = []
    with ProcessPoolExecutor(arguments.workers) as pool:
        for row in arguments.rows or ROWS:
            for name in arguments.filters.split(","):
                begun_s = time.monotonic()
                for place, line in enumerate(ROWS[row](Bench(pool, arguments.draws, name, arguments.hdop))):
                    records.append({"row": row, "filter": name, **line.record()})
                    if not arguments.json:
                        if not place:
                            heads = "".join(f"{figure.name:>8.8}      " for figure in line.figures)
                            print(f"\n{row + ', ' + name:<25}{'':<4}{heads}")
                        cells = "".join(map(str, line.figures))
                        print(f"{line.run:<25.24}{line.verdict:<4}{cells}{line.note}", flush=True)
                print(f"# {row}, {name}: {time.monotonic() - begun_s:.0f} s", file=sys.stderr)
    if arguments.json:
        print(json.dumps(records))


if __name__ == "__main__":
    main()
