"""A voyage of half a minute, and its log."""

from pathlib import Path

import pytest

from common.codec import decode_frame, encode_frame
from common.messages import Frame
from tests.navigate.voyages import frames_of, sail
from tests.station.logs import log_of


@pytest.fixture(scope="session")
def voyage() -> list[Frame]:
    """As received: IMU columns travel as 32-bit floats."""
    return [decode_frame(encode_frame(frame)) for frame in frames_of(sail(32, 0.05), 2)]


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory, voyage: list[Frame]) -> Path:
    return log_of(tmp_path_factory.mktemp("log"), voyage)
