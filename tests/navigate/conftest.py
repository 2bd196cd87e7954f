"""Simulated voyages shared by the tests of this folder."""

from collections.abc import Callable

import numpy as np
import pytest

from common.messages import Frame
from tests.navigate.voyages import Run, Truth, frames_of, measure, sail


@pytest.fixture(scope="session")
def mission() -> Truth:
    """T1 at 1 Hz for 600 s, with two turns."""
    return sail(600)


@pytest.fixture(scope="session")
def scenario_53(mission: Truth) -> Callable[[int], Run]:
    """Seed -> run with the thesis' change: from step 300 on GPS 20 m and compass 5 deg instead of 8/7 m and 0.8 deg."""
    count = len(mission.states)
    late = np.arange(count) >= 300
    gps = np.where(late[:, None], 20.0, np.array([8.0, 7.0]))
    compass = np.where(late, 5.0, 0.8)
    return lambda seed: measure(mission, seed, gps, compass)


@pytest.fixture(scope="session")
def short_voyage() -> list[Frame]:
    """A minute at 10 frames/s, the boat already under way."""
    return frames_of(sail(62, 0.05), 1)
