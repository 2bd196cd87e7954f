"""An estimate in the log: rounded far below its own doubt, still a covariance; its digest tells one changed bit."""

import json
import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.simulation.scenarios import scenario_voyage
from shore.logbook.estimate_rounding import BASIS, digest_of, is_stored_in, logged
from shore.pipeline import Pipeline
from tests.offline import frames_of


@pytest.fixture(scope="module")
def records() -> list[dict[str, Any]]:
    voyage = scenario_voyage("uncalibrated", seed=3, seconds=60.0)
    pipeline = Pipeline(voyage.config, ["fuzzy"])
    return [item.as_record() for frame in frames_of(voyage) for item in pipeline.push(frame).estimates]


def covariance(record: dict[str, Any]) -> np.ndarray:
    size = len(record["state"])
    P = np.zeros((size, size))
    P[np.triu_indices(size)] = record["covariance"]
    return P + np.triu(P, 1).T


def test_numbers_are_rounded_to_a_thousandth_of_their_own_sigma(records: list[dict[str, Any]]) -> None:
    for record in records:
        stored = logged(record)
        sigmas = np.sqrt(covariance(record).diagonal())
        assert np.all(np.abs(np.subtract(stored["state"], record["state"])) <= 0.5001e-3 * sigmas)
        assert stored["covariance"] == pytest.approx(record["covariance"], rel=1e-4)
        assert stored["lat_deg"] == pytest.approx(record["lat_deg"], abs=1e-9)
        assert stored["lon_deg"] == pytest.approx(record["lon_deg"], abs=1e-9)
        assert len(json.dumps(stored)) < 0.75 * len(json.dumps(record))


def test_a_stored_covariance_is_still_one(records: list[dict[str, Any]]) -> None:
    for record in records:
        P = covariance(logged(record))
        sigmas = np.sqrt(P.diagonal())
        assert np.linalg.eigvalsh(P / np.outer(sigmas, sigmas)).min() > 0.0


def test_stored_estimates_have_the_fields_of_published_ones(records: list[dict[str, Any]]) -> None:
    assert logged(records[-1]).keys() == records[-1].keys() | {"digest"}
    assert digest_of(logged(records[-1])) == digest_of(records[-1])


def _flipped(value: float) -> float:
    """The next bit pattern."""
    (bits,) = struct.unpack("<q", struct.pack("<d", value))
    return float(struct.unpack("<d", struct.pack("<q", bits ^ 1))[0])


def test_the_digest_sees_one_bit_anywhere(records: list[dict[str, Any]]) -> None:
    record = next(item for item in reversed(records) if item["channels"])
    whole = digest_of(record)
    data = json.dumps(logged(record), separators=(",", ":")).encode()
    for name, value in record.items():
        changed = value
        if isinstance(value, float):
            changed = _flipped(value)
        elif isinstance(value, bool):
            changed = not value
        elif isinstance(value, int):
            changed = value + 1
        elif isinstance(value, str):
            changed = value + "x"
        elif isinstance(value, list):
            changed = [*value[:-1], _flipped(value[-1])] if value and isinstance(value[-1], float) else [*value, "x"]
        if name in BASIS:  # compared as it is
            assert is_stored_in(data, record)
            assert not is_stored_in(data, {**record, name: changed}), name
        elif name != "channels":
            assert digest_of({**record, name: changed}) != whole, name
    channel = next(name for name, report in record["channels"].items() if report["nis"] is not None)
    for field in ("sigma", "nis"):
        report = {**record["channels"][channel], field: _flipped(record["channels"][channel][field])}
        assert digest_of({**record, "channels": {**record["channels"], channel: report}}) != whole


@given(st.floats(0.0, 360.0, exclude_max=True))
def test_a_rounded_direction_stays_below_360(heading_deg: float) -> None:
    zeros = ("t_ns", "seq", "repairs", "origin_lat_deg", "origin_lon_deg", "lat_deg", "lon_deg", "sog_kn")
    sigmas = ("sigma_east_m", "sigma_north_m", "sigma_heading_deg")
    record = {
        **dict.fromkeys(zeros, 0),
        **dict.fromkeys(sigmas, 1.0),
        "filter": "kf",
        "boot_id": "0" * 16,
        "names": [],
        "waiting": [],
        "channels": {},
        "aligned": True,
        "state": [],
        "covariance": [],
        "heading_true_deg": heading_deg,
        "cog_true_deg": heading_deg,
    }
    stored = logged(record)
    assert 0.0 <= stored["heading_true_deg"] < 360.0
    assert math.cos(math.radians(stored["cog_true_deg"] - heading_deg)) == pytest.approx(1.0)
