"""Replay of an hour: 10 frames a second, IMU 20 Hz, compass 10 Hz, a fix a second and 0.75 s late, nine states.

    python -m benchmarks.replay DIR                     # two minutes; 20 MB in DIR, which is made new
    python -m benchmarks.replay DIR --minutes 10        # a quick look

Ten minutes of scenario 5.3 follow each other again and again, and one filter runs over all of them while the log is
written. Every replay is a process of its own: start, reading, filtering, comparison with the recorded estimates.
The goal is 15 s for an hour.
"""

import argparse
import statistics
from collections.abc import Iterator
from pathlib import Path

from benchmarks.logbook import FILTER, ROUND_S, Step, measured, one_round, rounds, write_log
from common.boat_config import BoatConfig
from shore.pipeline import Pipeline

FRAME_HZ = 10
TURNS = 5


def filtered(config: BoatConfig, steps: list[Step], total: int) -> Iterator[Step]:
    """The frames of all rounds, with what one filter says of them."""
    pipeline = Pipeline(config, [FILTER])
    for frame, _ in rounds(steps, total, FRAME_HZ):
        yield frame, [estimate.as_record() for estimate in pipeline.push(frame).estimates]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, metavar="DIR")
    parser.add_argument("--minutes", type=float, default=60.0)
    arguments = parser.parse_args()
    arguments.directory.mkdir(parents=True)
    log = arguments.directory / "trip.mcap"
    seconds = arguments.minutes * 60.0
    config, steps = one_round(min(ROUND_S, seconds), FRAME_HZ)
    rows = write_log(log, config, filtered(config, steps, round(seconds * FRAME_HZ)))
    print(f"log: {rows} estimates of {arguments.minutes:g} minutes, {log.stat().st_size / 1e6:.1f} MB", flush=True)
    turns = [measured("replay", log) for _ in range(TURNS)]
    took_s = sorted(turn[0] for turn in turns)
    print(f"replay: median {statistics.median(took_s):.1f} s of {TURNS}, {took_s[0]:.1f} to {took_s[-1]:.1f} s")
    print(f"peak RSS {max(turn[1] for turn in turns):.0f} MB")


if __name__ == "__main__":
    main()
