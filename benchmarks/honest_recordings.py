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
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final

from benchmarks import recorded_voyages as voyages
from benchmarks.asked import Figure, Line, median, notes, ratio
from benchmarks.recorded_cases import cases
from benchmarks.recorded_runs import (
    SHARED,
    Bench,
    Jobs,
    Sailed,
    course_at_rest,
    course_of_fixes,
    imported_frames,
    near_fix,
    sail,
    sail_voyage,
    total,
)

DATA: Final = SHARED / "data"
BLUEBOATS: Final = ("216", "218", "220", "224", "225", "228", "232", "235")
STILL: Final = (
    "radar-ttm-nmea/RadarLogs_lines_20001-40000.txt",
    "signalk-boat-nmea/gofree-merrimac.log",
    "gpsd-receivers/sirfstarv-nmea.log",
)
"""Moored boats with a compass, and a receiver that lies still, alone. None of them is under way."""
PEER_BLUEBOAT_M: Final = {"220": 0.82, "224": 0.87, "225": 0.80, "232": 0.81, "235": 0.83}
"""What the peer reached on the same recordings (position RMS, m)."""


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
