"""How long a simulated hour takes without ports: readings, frames, pipeline; seconds of one core.

python -m benchmarks.without_ports [--hours 1] [--rounds 5]
"""

import argparse
import json
import statistics
import time
from itertools import pairwise

from common.boat_config import BoatConfig, BoatTable, FramesTable, PortTable, SensorTable
from common.simulation.scenarios import find_world
from common.simulation.voyage import boat_voyage
from common.simulation.without_ports import frames_of
from shore.pipeline import Pipeline

COMPASSES = (("compass1", "hsc100"), ("compass2", "tcm2"), ("compass3", "hmr3000"))
BOAT = BoatConfig(
    boat=BoatTable(id="hour", variation_deg=0.0),
    frames=FramesTable(rate_hz=1.0),
    port=(PortTable(name="a", path="a"),),
    sensor=(
        SensorTable(id="gps1", port="a", role="gps", rate_hz=1.0),
        SensorTable(id="imu1", port="a", role="imu", rate_hz=1.0, model="arduimu"),
        *(SensorTable(id=name, port="a", role="compass", rate_hz=1.0, model=model) for name, model in COMPASSES),
    ),
)
"""Everything at 1 Hz, three compasses of three makes."""


def one_round(seconds: float, seed: int) -> dict[str, float]:
    """Seconds of processor time for making the voyage, cutting frames, filtering them."""
    marks = [time.process_time()]
    voyage = boat_voyage(find_world("real-lake"), BOAT, seed, seconds)
    marks.append(time.process_time())
    frames = list(frames_of(voyage))
    marks.append(time.process_time())
    pipeline = Pipeline(BOAT, ["fuzzy"])
    for frame in frames:
        pipeline.push(frame)
    marks.append(time.process_time())
    made, cut, filtered = (after - before for before, after in pairwise(marks))
    return {"voyage_s": made, "frames_s": cut, "pipeline_s": filtered, "whole_s": marks[-1] - marks[0]}


def main() -> None:
    """Print the median of the rounds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    rounds = [one_round(3600.0 * arguments.hours, seed) for seed in range(1, arguments.rounds + 1)]
    print(json.dumps({name: round(statistics.median(each[name] for each in rounds), 2) for name in rounds[0]}))


if __name__ == "__main__":
    main()
