"""Makes the golden cases anew: `.venv/bin/python -m tests.golden.make_logs [NAME...]`; those that exist are left alone.

Simulated voyages in frames of half a second; equal arguments give equal frames. Remove a case's directory first to make
it anew, and read the diff (tests/golden/README.md).
"""

import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from common.boat_config import BoatConfig
from common.codec import encode_frame
from common.framer import merge
from common.messages import Frame
from common.simulation.readings import Rates
from common.simulation.scenarios import scenario_voyage
from shore.logbook.log_writer import log_at
from shore.replay.frames import Span
from shore.trips.golden_case import EVERY_S, LOG, Case, write_case
from tests.golden.exact_frames import exact_frames

HERE = Path(__file__).parent
UTC_NS = 1_795_000_000_000_000_000
SEED = 7
RATES = Rates(gps_hz=1.0, compass_hz=2.0, imu_hz=10.0)
BOARD_FRAMES = 5
"""Merged into one, as for a client that asks for a longer period."""

Frames = list[Frame]
Change = Callable[[BoatConfig, Frames], tuple[BoatConfig, Frames]]


def as_is(config: BoatConfig, frames: Frames) -> tuple[BoatConfig, Frames]:
    return config, frames


def without(role: str) -> Change:
    """The boat has no such sensor."""
    lists = {"imu": "imu", "compass": "headings"}[role]

    def change(config: BoatConfig, frames: Frames) -> tuple[BoatConfig, Frames]:
        sensors = tuple(sensor for sensor in config.sensor if sensor.role != role)
        bare: dict[str, Any] = {lists: ()}
        return replace(config, sensor=sensors), [replace(frame, **bare) for frame in frames]

    return change


def late_and_shuffled(config: BoatConfig, frames: Frames) -> tuple[BoatConfig, Frames]:
    """Half of the frames come up to 3 s late; 15 s of the link are lost and come after it has returned."""
    rng = np.random.default_rng(SEED)
    delay_s = np.where(rng.random(len(frames)) < 0.5, rng.uniform(0.0, 3.0, len(frames)), 0.0)
    begin_ns, end_ns = frames[80].t1_ns, frames[110].t1_ns
    arrival = [
        frame.t1_ns + round(1e9 * late) if not begin_ns <= frame.t1_ns < end_ns else end_ns + round(1e10 + 1e9 * late)
        for frame, late in zip(frames, delay_s, strict=True)
    ]
    return config, [frames[place] for place in np.argsort(arrival, kind="stable")]


def restarted(config: BoatConfig, frames: Frames) -> tuple[BoatConfig, Frames]:
    """The daemon is started again after a third, 4 s are lost; after another third the board is rebooted."""
    first, second, third = frames[:70], frames[78:150], frames[152:]
    back_ns = third[0].t0_ns - 10**9
    second = [renamed(frame, "1" * 16, 2, "clock", frame.seq - second[0].seq + 5, 0) for frame in second]
    third = [renamed(frame, "2" * 16, 3, "clock-2", frame.seq - third[0].seq + 5, back_ns) for frame in third]
    return config, [*first, *second, *third]


def renamed(frame: Frame, boot_id: str, start_no: int, clock_id: str, seq: int, back_ns: int) -> Frame:
    shifted: dict[str, Any] = {
        kind: tuple(replace(item, t_ns=item.t_ns - back_ns) for item in getattr(frame, kind))
        for kind in ("fixes", "headings", "imu")
    }
    return replace(
        frame, boot_id=boot_id, start_no=start_no, clock_id=clock_id, seq=seq, first_seq=seq - BOARD_FRAMES + 1,
        t0_ns=frame.t0_ns - back_ns, t1_ns=frame.t1_ns - back_ns, **shifted,
    )  # fmt: skip


@dataclass(frozen=True)
class Made:
    """A case: which voyage, which part of it, and what is done to its frames."""

    text: str
    scenario: str
    from_s: float
    to_s: float
    filters: tuple[str, ...] = ("fuzzy", "ukf")
    change: Change = as_is
    order: str = "arrival"


CASES = {
    "moored": Made("moored boat (section 4.1.1)", "4.0", 0.0, 80.0),
    "straight": Made("straight line in still water (Table 4.2)", "4.1", 0.0, 80.0, ("fuzzy", "kf")),
    "turns": Made("two turns to port in still water (Table 4.3)", "4.2", 0.0, 100.0, ("fuzzy", "ukf", "kf")),
    "current": Made("straight line in a current of 0.5 m/s (Table 4.5)", "4.3-0.5", 0.0, 80.0),
    "coast-current": Made("turns in a current that varies along the coast (Table 4.7)", "4.4-T1", 0.0, 100.0),
    "noise-step": Made(
        "the noise of GPS and compass grows at 300 s of the voyage (Table 5.7)",
        "5.3", 250.0, 360.0, ("fuzzy", "fuzzy-thesis", "ukf"),
    ),
    "agile": Made("a slalom at 4 m/s with a compass of 20 deg", "agile", 0.0, 80.0, ("fuzzy", "ukf", "kf")),
    "uncalibrated": Made("the full bias of an uncalibrated IMU (Table 5.4)", "uncalibrated", 0.0, 100.0),
    "tidal-outage": Made("no GPS from 300 s of the voyage on, the current grows", "tidal-outage", 250.0, 370.0),
    "late-and-shuffled": Made("late frames and a backfill after a cut", "4.2", 0.0, 100.0, change=late_and_shuffled),
    "by-time": Made(
        "the same frames as late-and-shuffled, in order of boat time", "4.2", 0.0, 100.0,
        change=late_and_shuffled, order="time",
    ),
    "restarts": Made("a restart of the daemon, then a reboot of the board", "4.2", 0.0, 100.0, change=restarted),
    "without-imu": Made("turns, no IMU on board", "4.2", 0.0, 100.0, change=without("imu")),
    "without-compass": Made("turns, no compass on board", "4.2", 0.0, 100.0, change=without("compass")),
}  # fmt: skip


def main(names: Sequence[str]) -> None:
    for name in names or CASES:
        if (HERE / name).exists():
            print(f"{name}: is there already")
            continue
        with TemporaryDirectory() as directory:
            made, log = CASES[name], Path(directory) / LOG
            write_log(log, made)
            by = f"python -m tests.golden.make_logs {name}"
            case = Case(HERE / name, name, made.text, by, made.filters, made.order, EVERY_S)
            print(name, write_case(log, case, Span()))


def write_log(path: Path, made: Made) -> None:
    voyage = scenario_voyage(made.scenario, seed=SEED, seconds=made.to_s, rates=RATES)
    board = [frame for frame in exact_frames(voyage) if frame.seq >= made.from_s * 10.0]
    merged = [merge(board[place : place + BOARD_FRAMES]) for place in range(0, len(board), BOARD_FRAMES)]
    config, frames = made.change(voyage.config, merged)
    writer = log_at(path)
    connected = {"config": without_none(asdict(config)), "boot_id": frames[0].boot_id, "next_seq": 0}
    writer.write_session(
        {"kind": "start", "options": {"step_s": None}, "connected": connected, "utc_ns": UTC_NS}, UTC_NS
    )
    for place, frame in enumerate(frames):
        writer.write_frame(encode_frame(frame), frame, UTC_NS + place * 500_000_000)
    writer.close()


def without_none(value: Any) -> Any:
    """As on the wire: what is missing is absent."""
    if isinstance(value, dict):
        return {key: without_none(each) for key, each in value.items() if each is not None}
    return (
        [without_none(each) for each in value] if isinstance(value, Iterable) and not isinstance(value, str) else value
    )


if __name__ == "__main__":
    main(sys.argv[1:])
