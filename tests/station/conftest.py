"""A voyage of half a minute and its log; a trip and all its exports."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from common.codec import decode_frame, encode_frame
from common.events import event
from common.messages import Event, Frame
from common.settings import as_dict
from common.simulation.scenarios import scenario_voyage
from shore.logbook.log_reader import read_log
from shore.logbook.log_writer import log_at
from shore.logbook.session import start_record
from shore.pipeline import Pipeline
from tests import offline
from tests.navigate.voyages import frames_of, sail
from tests.station.exporting import HORROR, KINDS, UTC_NS, export
from tests.station.logs import log_of


@pytest.fixture(scope="session")
def voyage() -> list[Frame]:
    """As received: IMU columns travel as 32-bit floats."""
    return [decode_frame(encode_frame(frame)) for frame in frames_of(sail(32, 0.05), 2)]


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory, voyage: list[Frame]) -> Path:
    return log_of(tmp_path_factory.mktemp("log"), voyage)


@pytest.fixture(scope="module")
def trip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Forty seconds with two filters, UTC, a warning and an unprintable event."""
    path = tmp_path_factory.mktemp("log") / "trip.mcap"
    voyage = scenario_voyage("5.3", seed=1, seconds=40.0)
    config = voyage.config
    frames = [
        replace(frame, utc_ns=UTC_NS + frame.t0_ns, utc_unc_ns=10**8, utc_src="gnss")
        for frame in offline.frames_of(voyage)
    ]
    odd = Event(t_ns=frames[200].t1_ns, source="gps1", code="odd", level="warning", text=HORROR)
    frames[200] = replace(frames[200], events=(odd,))
    pipeline = Pipeline(config, ["fuzzy", "ukf"])
    writer = log_at(path)
    options = {"filters": ["fuzzy", "ukf"], "step_s": None}
    writer.write_session(start_record({"config": as_dict(config)}, options, UTC_NS), UTC_NS)
    writer.write_session({"kind": "trip", "name": HORROR, "note": HORROR}, UTC_NS)
    for data, frame, output in offline.pushed(pipeline, frames):
        now_ns = UTC_NS + frame.t1_ns + 30_000_000
        writer.write_frame(data, frame, now_ns)
        if frame.seq % 10 == 0:
            writer.sync()
        for estimate in output.estimates:
            writer.write_estimate(estimate.as_record(), now_ns)
        for happening in (*frame.events, *output.events):
            writer.write_event(happening, now_ns)
    writer.write_event(event("link-lost", frames[100].t1_ns, "link", age_s=3.5), now_ns)
    writer.close()
    return path


@pytest.fixture(scope="module")
def recorded(trip: Path) -> list[dict[str, Any]]:
    return list(read_log(trip).estimates("fuzzy"))


@pytest.fixture(scope="module")
def out(trip: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every format of that trip, in `trip.<format>`."""
    directory = tmp_path_factory.mktemp("out")
    for kind in KINDS:
        assert export(trip, "--to", kind, directory / f"trip.{kind}") == 0
    return directory
