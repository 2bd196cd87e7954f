"""What the live filter makes of the frames that come over too small a link: the running sums bridge the others.

Frames with a fix are not passed over (`onboard.link.server`). Were they skipped like the others, the position would be
1.19 times as wrong (50 voyages, 1.13 to 1.26): a third of the fixes is missing then, and nothing bridges a fix.
"""

import random
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from common.boat_config import FramesTable
from common.messages import Frame
from common.simulation.readings import Rates
from common.simulation.scenarios import scenario_voyage
from common.simulation.voyage import Voyage
from shore.pipeline import Pipeline
from tests import offline

FRAME_HZ = 20
SKIPPED = 0.31
"""Share of 1.4 Mbit/s that a link of 1 Mbit/s leaves behind (tests/system/test_load_limited.py)."""
SEEDS = 50
FULL_S = 10.0
"""The link is large enough while the filter starts."""


def rms_m(voyage: Voyage, frames: Iterable[Frame], name: str = "fuzzy") -> float:
    pipeline = Pipeline(voyage.config, [name])
    estimates = [estimate for frame in frames for estimate in pipeline.push(frame).estimates]
    return offline._errors(voyage, estimates).rms_m(0.2)


def voyage_of(seed: int, seconds: float) -> tuple[Voyage, list[Frame], list[bool]]:
    """A voyage, its frames, and which of them came."""
    voyage = scenario_voyage("5.3", seed=seed, rates=Rates(compass_hz=FRAME_HZ, imu_hz=FRAME_HZ), seconds=seconds)
    voyage = replace(voyage, config=replace(voyage.config, frames=FramesTable(rate_hz=FRAME_HZ)))
    frames = offline.frames_of(voyage)
    draw = random.Random(seed)
    came = [draw.random() > SKIPPED or bool(frame.fixes) or frame.seq < FULL_S * FRAME_HZ for frame in frames]
    return voyage, frames, came


def test_what_the_imu_did_in_frames_that_did_not_come_is_not_lost() -> None:
    """Every third second is missing but for its fixes: with the sums nothing is lost.

    Without them a filter that takes the IMU for what its channel says loses a lot; that of a real boat is on its guard.
    """
    voyage, frames, _ = voyage_of(3, 60.0)
    came = [frame.seq < FULL_S * FRAME_HZ or frame.seq // FRAME_HZ % 3 != 0 for frame in frames]
    holes = [f if is_here else replace(f, imu=(), headings=()) for f, is_here in zip(frames, came, strict=True)]
    none: dict[str, Any] = dict.fromkeys(("sum_accel_fwd_m_s", "sum_accel_stb_m_s", "sum_yaw_deg"), 0.0)
    none |= {"sum_count": 0, "sum_time_s": 0.0}
    dumb = [replace(frame, imu=tuple(replace(block, **none) for block in frame.imu)) for frame in holes]
    whole_m = rms_m(voyage, frames)
    assert rms_m(voyage, holes) == pytest.approx(whole_m, rel=0.002)
    plain = "fuzzy-thesis"
    assert rms_m(voyage, dumb, plain) > 1.3 * rms_m(voyage, frames, plain)


@pytest.mark.slow
def test_the_position_is_as_good_with_the_frames_that_came() -> None:
    ratios = []
    for seed in range(SEEDS):
        voyage, frames, came = voyage_of(seed, 60.0)
        ratios.append(
            rms_m(voyage, (f for f, is_here in zip(frames, came, strict=True) if is_here)) / rms_m(voyage, frames)
        )
    mean = float(np.exp(np.mean(np.log(ratios))))
    print(f"\n  gaps: RMS {mean:.3f} times that with all frames ({min(ratios):.2f} to {max(ratios):.2f})")
    assert mean <= 1.1
