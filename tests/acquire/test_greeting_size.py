from pathlib import Path

import pytest

from common.boat_config import BoatConfig
from common.errors import WayfixError
from common.framer import Identity
from common.frames_file import FramesFile, write_frames_file
from onboard.config import load
from onboard.reading.acquisition import Acquisition
from tests.cases import CASES, needs_cases

MADE = {"file": {"format": 1, "clock": "boat"}}


def greeting(config: BoatConfig) -> dict[str, object]:
    acquisition = Acquisition(config, Identity("b", "0" * 16, "clock", 1), 0, 0, lambda _event: None)
    return {**acquisition.greeting(0, 1.0), **MADE}


@needs_cases
def test_many_sensors_fit_into_a_frames_file(tmp_path: Path) -> None:
    config = load(CASES / "board" / "many-sensors.toml")
    assert len(config.sensor) == 33
    write_frames_file(tmp_path / "o.frames", greeting(config), [])
    with FramesFile(tmp_path / "o.frames") as file:
        assert len(file.greeting["config"]["sensor"]) == 33


def test_a_greeting_that_no_reader_takes_is_refused_by_its_writer(tmp_path: Path) -> None:
    with pytest.raises(WayfixError, match="describe fewer sensors in one file"):
        write_frames_file(tmp_path / "o.frames", {"sensors": ["x" * 1000] * 400, **MADE}, [])
    assert not (tmp_path / "o.frames").exists()
