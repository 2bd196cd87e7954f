"""Cases with truth (test vectors): imported, replayed, and scored beside what is right and what a peer reached.

The last six are the healthy case with its fixes or its compass spoilt from the middle on, in the frames.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from benchmarks.asked import Figure, Line, notes
from benchmarks.recorded_runs import (
    NOTHING,
    SHARED,
    Bench,
    Sailed,
    course_of_reference,
    imported_frames,
    sail,
    total,
    usable_fixes,
)
from common.angles import wrap_deg
from common.geodesy import LocalPlane
from common.messages import Fix, Frame, Heading
from common.units import NS_PER_S

CASES: Final = SHARED / "cases" / "accuracy"
SPOILT_FROM_S: Final = 150.0
"""Middle of the healthy case, s."""


@dataclass(frozen=True, slots=True)
class Case:
    """What is right for a case, and what the peer reached."""

    asks: dict[str, dict[str, Any]] = field(default_factory=dict)
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
PEER_SPOILT: Final = {
    "fixes 50 m off for 30 s": Case(peer_m=0.64),
    "fixes 50 m off for good": Case(peer_m=0.98),
    "no fixes for 60 s": Case(peer_m=481.0),
    "fixes run off, 0.5 m/s": Case(peer_m=32.0),
    "fixes frozen": Case(peer_m=59.0),
    "compass 20 deg off": Case(peer_m=0.61, peer_deg=15.5),
}
"""Nothing is asked of these but to be before the peer."""
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


def sail_spoilt(case: str, name: str) -> Sailed:
    config, frames = imported_frames(CASES / "healthy.csv", CASES / "map.toml")
    course = course_of_reference(CASES / "healthy-truth.csv", frames)
    return sail(config, spoilt(frames, case, course.plane, course.start_ns), name, course)[""]


def spoilt(frames: Sequence[Frame], case: str, plane: LocalPlane, start_ns: int) -> list[Frame]:
    """The frames of a healthy boat as a case of `PEER_SPOILT` has them."""
    frozen = next(fix for fix in usable_fixes(frames) if fix.t_ns >= start_ns + SPOILT_FROM_S * NS_PER_S)

    def moved(fix: Fix, north_m: float) -> Fix:
        assert fix.lat_deg is not None
        assert fix.lon_deg is not None
        east, north = plane.to_east_north_m(fix.lat_deg, fix.lon_deg)
        lat_deg, lon_deg = plane.to_lat_lon_deg(east, north + north_m)
        return replace(fix, lat_deg=lat_deg, lon_deg=lon_deg)

    def as_spoilt(fix: Fix) -> Fix | None:
        since_s = (fix.t_ns - start_ns) / NS_PER_S - SPOILT_FROM_S
        if since_s < 0.0 or not fix.usable:
            return fix
        match case:
            case "fixes 50 m off for 30 s":
                return moved(fix, 50.0 if since_s < 30.0 else 0.0)
            case "fixes 50 m off for good":
                return moved(fix, 50.0)
            case "no fixes for 60 s":
                return None if since_s < 60.0 else fix
            case "fixes run off, 0.5 m/s":
                return moved(fix, 0.5 * since_s)
            case "fixes frozen":
                return replace(frozen, t_ns=fix.t_ns)
        return fix

    def turned(heading: Heading) -> Heading:
        is_turned = case == "compass 20 deg off" and heading.t_ns >= start_ns + SPOILT_FROM_S * NS_PER_S
        if not is_turned or heading.heading_true_deg is None:
            return heading
        return replace(heading, heading_true_deg=wrap_deg(heading.heading_true_deg + 20.0))

    return [
        replace(
            frame,
            fixes=tuple(fix for each in frame.fixes if (fix := as_spoilt(each)) is not None),
            headings=tuple(map(turned, frame.headings)),
        )
        for frame in frames
    ]


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
    jobs |= {case: bench.pool.submit(sail_spoilt, case, bench.filter) for case in PEER_SPOILT}
    before = 0
    parts = bench.pool.submit(sail_rtk_single, bench.filter)
    for case, job in jobs.items():
        sailed, failed = total([job])
        right = RIGHT.get(case) or PEER_SPOILT[case]
        position_m = sailed.figure("position_m")
        before += right.peer_m is not None and position_m is not None and position_m <= right.peer_m
        figures = tuple(
            Figure(CASE_FIGURES[name], sailed.figure(name), **right.asks.get(name, {})) for name in CASE_FIGURES
        )
        peer = Figure("peer_m", right.peer_m), Figure("peer_deg", right.peer_deg)
        yield Line(case, (*figures, *peer), notes(failed, _first(sailed, right), sailed.events_said() or "no event"))
    named = sum(case.peer_m is not None for case in (*RIGHT.values(), *PEER_SPOILT.values()))
    yield Line("positions before peer", (Figure("number", float(before)), Figure("of", float(named))))
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
