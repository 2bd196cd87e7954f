"""Stress bench (Monte Carlo, fault injection): boats with bad sensors, false figures and lost fixes, without ports.

    python -m benchmarks.stress [ROW ...] [--boats 20] [--first 1] [--filters fuzzy] [--workers 2] [--json] [--list]

A row is a world of `stress_rows`. ROW is a name, the beginning of names (`imu`), or a pattern (`imu-*-nov`). Figures
are over all boats and times of a part, from the first minute on unless the row says otherwise.

* RMS errors, in95 and e/s are as in `benchmarks.honesty`. `raw_ratio` = position / raw fixes; `beside_ratio` = position
  / that of the same boat without the sensor that is wrong.
* `*_blamed` = boats with such an event (those before a fault are not counted). `*_named_s` = the longest time of a boat
  from the fault to the first such event, inf when a boat has none; of the gyro it is from the beginning of the first
  turn that passes 20 deg after the fault, `gyro_named20_s` from when it has passed them, `gyro_onset_s` from the fault;
  `imu_*` = the same with any event that sets a part of the inertial unit aside.
* `given`, `aligned` = share of the frames after the first minute with an estimate.
* Starts: a quantile of error / own sigma (position: sqrt(d^2 / 2)), and the wait until the first aligned estimate.
"""

import argparse
import json
import math
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from benchmarks.scoring import SETTLED_S, Array, Sums, errors_of, voyage_s
from benchmarks.stress_messages import PLANE, Fixes, frames_of
from benchmarks.stress_rows import BLAMES, Row, rows_named
from benchmarks.stress_world import LEGS, Boat, World, sail
from common.errors import WayfixError
from shore.navigation.estimate import Estimate
from shore.pipeline import Pipeline

START_S: Final = 60.0
"""Length of the time from the first aligned estimate on that a start is judged by."""
QUIET: Final = ("filter-started", "filter-waiting", "filter-aligned")
SHOWN: Final = ("position_m", "in95", "position_e_s", "velocity_m_s", "heading_deg", "heading_e_s", "raw_m")


@dataclass(frozen=True, slots=True)
class Score:
    """One filter on one boat."""

    parts: dict[str, Sums]
    given: float
    """Share of the frames after the first minute that have an estimate."""
    aligned: float
    wait_s: float
    """When the first estimate is aligned, s; inf = never."""
    start_position: Array
    """Error / own sigma of the aligned estimates of the first minute of them, (n,)."""
    start_heading: Array


@dataclass(frozen=True, slots=True)
class Run:
    """All filters on one boat; the events are those of all of them."""

    scores: dict[str, Score]
    events: tuple[tuple[float, str], ...]
    """Time (s) and code of each."""
    turn_s: tuple[float, float] | None
    """When the first turn after the onset of an IMU fault begins, and when it has passed 20 deg."""


def one_boat(world: World, seed: int, filters: Sequence[str], seconds: float) -> Run:
    """Sail a boat and score it."""
    boat = sail(world, seed, seconds)
    fixes = Fixes(boat)
    pipeline = Pipeline(world.config(), list(filters))
    estimates: list[Estimate] = []
    events: list[tuple[float, str]] = []
    ends_s = []
    for frame in frames_of(boat, fixes):
        output = pipeline.push(frame)
        estimates += output.estimates
        events += [(voyage_s(item.t_ns), item.code) for item in output.events]
        ends_s.append(voyage_s(frame.t1_ns))
    frames = sum(end_s >= SETTLED_S for end_s in ends_s)
    scores = {
        name: _score(boat, fixes, [item for item in estimates if item.filter == name], frames) for name in filters
    }
    onset_s = world.imu_fault.from_s if world.imu_fault else 0.0
    return Run(scores, tuple(events), boat.first_turn_from(onset_s))


def _score(boat: Boat, fixes: Fixes, estimates: Sequence[Estimate], frames: int) -> Score:
    world = boat.world
    aligned = [item for item in estimates if item.aligned]
    errors = errors_of(estimates if world.any_estimate else aligned, boat.truth, PLANE)
    sums = {}
    for name, from_s, to_s in scored_parts(boat, fixes):
        keep = (errors.t_s >= from_s) & (errors.t_s < to_s)
        if world.at_fixes:
            keep &= np.abs(errors.t_s * world.gps_hz - np.round(errors.t_s * world.gps_hz)) < 1e-6
        scored = (fixes.quality > 0) & (fixes.t_s >= from_s) & (fixes.t_s < to_s)
        sums[name] = errors.sums(keep, (float(np.sum(fixes.error_m[scored] ** 2)), float(np.count_nonzero(scored))))
    first_s = voyage_s(aligned[0].t_ns) if aligned else math.inf
    start = [item for item in aligned if voyage_s(item.t_ns) <= first_s + START_S]
    begun = errors_of(start, boat.truth, PLANE)
    return Score(
        sums,
        _share(estimates, frames),
        _share(aligned, frames),
        first_s,
        np.sqrt(begun.distances() / 2.0),
        np.abs(begun.heading_deg) / np.sqrt(begun.heading_variance),
    )


def _share(estimates: Sequence[Estimate], frames: int) -> float:
    """Share of the frames after the first minute that have such an estimate."""
    return sum(voyage_s(item.t_ns) >= SETTLED_S for item in estimates) / max(frames, 1)


def scored_parts(boat: Boat, fixes: Fixes) -> tuple[tuple[str, float, float], ...]:
    """What is scored; after an outage that is the last estimate before the first fix."""
    if boat.outage is None:
        return boat.world.parts
    back_s = float(min(fixes.t_s[fixes.t_s >= boat.outage[1]], default=math.inf))
    period_s = 1.0 / boat.world.config().frames.rate_hz
    return (("", back_s - period_s + 1e-6, back_s + 1e-6),)


def figures_of(row: Row, name: str, runs: Sequence[Run], beside: Sequence[Run] | None) -> dict[str, float]:
    """All figures of a filter in a row."""
    scores = [run.scores[name] for run in runs]
    figures: dict[str, float] = {}
    for part in scores[0].parts:
        total = _total(runs, name, part)
        tail = f".{part}" if part else ""
        found = total.figures()
        found["position_shown_m"] = math.sqrt(total.position_shown / (total.count or math.nan))
        found["raw_ratio"] = found["position_m"] / found["raw_m"]
        figures |= {f"{key}{tail}": value for key, value in found.items()}
        if beside is not None:
            of_beside = _total(beside, name, part).figures()
            figures[f"beside_ratio{tail}"] = found["position_m"] / of_beside["position_m"]
    figures["given"] = float(np.mean([score.given for score in scores]))
    figures["aligned"] = float(np.mean([score.aligned for score in scores]))
    waits = [score.wait_s for score in scores]
    figures["wait_s"], figures["wait_most_s"] = float(np.mean(waits)), max(waits)
    if row.start is not None:
        for key, ratios in (
            ("start_position", [score.start_position for score in scores]),
            ("start_heading", [score.start_heading for score in scores]),
        ):
            together = np.concatenate(ratios)
            figures[key] = float(np.quantile(together, row.start)) if together.size else math.nan
    return figures | _named(row.world, runs)


def _total(runs: Sequence[Run], name: str, part: str) -> Sums:
    return sum((run.scores[name].parts[part] for run in runs), start=Sums())


def _named(world: World, runs: Sequence[Run]) -> dict[str, float]:
    """How many boats have events that put the blame on a sensor, and how long it takes where there is a fault."""
    faults = {"gyro": world.imu_fault, "imu": world.imu_fault}
    faults |= {"compass": world.disturbance, "velocity": world.velocity_fault}
    figures = {"blamed": float(sum(any(_blames(code, "any") for _, code in run.events) for run in runs))}
    for sensor, fault in faults.items():
        from_s = fault.from_s if fault else -math.inf
        times = [[t_s for t_s, code in run.events if _blames(code, sensor) and t_s >= from_s] for run in runs]
        firsts = [min(each, default=None) for each in times]
        figures[f"{sensor}_blamed"] = float(sum(first is not None for first in firsts))
        if fault is None:
            continue
        turned = fault is world.imu_fault
        figures[f"{sensor}_onset_s" if turned else f"{sensor}_named_s"] = max(_less(first, from_s) for first in firsts)
        if turned:
            pairs = [(first, run.turn_s) for first, run in zip(firsts, runs, strict=True) if run.turn_s is not None]
            for key, which in (("named_s", 0), ("named20_s", 1)):
                late = (_less(first, turn_s[which]) for first, turn_s in pairs)
                figures[f"{sensor}_{key}"] = max(late, default=math.nan)
    return figures


def _less(first_s: float | None, from_s: float) -> float:
    return math.inf if first_s is None else first_s - from_s


def _blames(code: str, sensor: str) -> bool:
    """Whether an event puts the blame on a sensor; `imu` = on any part of the inertial unit, `any` = on any sensor."""
    if sensor in BLAMES:
        return code in BLAMES[sensor]
    if sensor == "imu" and (_blames(code, "compass") or _blames(code, "velocity")):
        return False
    return code.endswith("-set-aside") or code in BLAMES["gyro"]


def _said(runs: Sequence[Run]) -> dict[str, dict[str, float]]:
    """Events by code: in how many boats, how many in all, and the earliest time (s)."""
    boats = Counter(code for run in runs for code in {code for _, code in run.events})
    times: dict[str, list[float]] = {}
    for run in runs:
        for t_s, code in run.events:
            times.setdefault(code, []).append(t_s)
    return {
        code: {"boats": boats[code], "events": len(at), "first_s": min(at)}
        for code, at in sorted(times.items())
        if code not in QUIET
    }


Job = tuple[World, int, tuple[str, ...], float]


def _jobs(row: Row, arguments: argparse.Namespace) -> tuple[list[Job], list[Job]]:
    """The boats of a row, and those beside."""
    filters = tuple(arguments.filters.split(",")) if arguments.filters else row.filters
    seconds = min(row.seconds, arguments.seconds)
    seeds = range(arguments.first, arguments.first + arguments.boats)
    beside = [(_tracked(row.beside, arguments.track), seed, filters, seconds) for seed in seeds] if row.beside else []
    return [(_tracked(row.world, arguments.track), seed, filters, seconds) for seed in seeds], beside


def _tracked(world: World, track: str) -> World:
    """The world with another track of legs and turns."""
    return replace(world, track=track) if world.track in LEGS else world


def records(rows: Sequence[Row], arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A record for each row and filter, as soon as it is known."""
    with ProcessPoolExecutor(arguments.workers) as pool:
        running: dict[Job, Future[Run]] = {}
        for job in (job for row in rows for jobs in _jobs(row, arguments) for job in jobs):
            if job not in running:
                running[job] = pool.submit(one_boat, *job)
        for row in rows:
            try:
                ours, beside = ([running[job].result() for job in jobs] for jobs in _jobs(row, arguments))
            except Exception as error:
                # The other rows are worth their hours.
                yield {"row": row.name, "failed": f"{type(error).__name__}: {error}"}
                continue
            for name in ours[0].scores:
                yield _record(row, name, ours, beside)


def _record(row: Row, name: str, ours: Sequence[Run], beside: Sequence[Run]) -> dict[str, Any]:
    figures = figures_of(row, name, ours, beside or None)
    values = [(ask, figures.get(ask.figure, math.nan)) for ask in row.asks]
    asks = [{"figure": ask.figure, "ask": str(ask), "value": value, "ok": ask.holds(value)} for ask, value in values]
    return {"row": row.name, "filter": name, "boats": len(ours), "figures": figures, "asks": asks, "said": _said(ours)}


def line_of(record: dict[str, Any]) -> str:
    """A record as one line: the usual figures, each ask beside its figure, the events."""
    if "failed" in record:
        return f"{record['row']:<28}FAILED: {record['failed']}"
    shown = "".join(f"{record['figures'].get(key, math.nan):>8.2f}" for key in SHOWN)
    asks = "; ".join(
        f"{ask['figure']} {ask['value']:.3g} {ask['ask']} {'ok' if ask['ok'] else '-'}" for ask in record["asks"]
    )
    said = ", ".join(
        f"{code} {of['boats']}/{record['boats']} first {of['first_s']:.0f} s" for code, of in record["said"].items()
    )
    return f"{record['row']:<28}{record['filter']:<9}{shown}  {asks}" + (f"  [{said}]" if said else "")


def heading() -> str:
    """The line above."""
    short = {"position_m": "pos m", "position_e_s": "e/s", "velocity_m_s": "vel m/s", "heading_deg": "hdg deg"}
    names = [short.get(key, key.replace("heading_e_s", "hdg e/s").replace("_m", " m")) for key in SHOWN]
    return f"{'row':<28}{'filter':<9}" + "".join(f"{name:>8}" for name in names) + "  asks [events]"


def main() -> int:
    """Print a line for each row and filter; exit code 1 when a row failed to run, whatever the asks say."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("rows", nargs="*", metavar="ROW")
    parser.add_argument("--boats", type=int, default=20)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--filters", help="default: fuzzy; in starts fuzzy,imm,fuzzy-qr")
    parser.add_argument("--seconds", type=float, default=600.0, help="at most; rows may be shorter")
    parser.add_argument("--track", default="legs", choices=LEGS, help="drawn, or as in the studies, which is easier")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--list", action="store_true", help="name the rows and end")
    arguments = parser.parse_args()
    try:
        rows = rows_named(arguments.rows)
    except WayfixError as error:
        print(error, file=sys.stderr)
        return 2
    if arguments.list:
        for row in rows:
            print(f"{row.name:<28}{'; '.join(f'{ask.figure} {ask}' for ask in row.asks)}")
        return 0
    if not arguments.json:
        print(heading())
    failed = False
    for record in records(rows, arguments):
        failed |= "failed" in record
        print(json.dumps(record) if arguments.json else line_of(record), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
