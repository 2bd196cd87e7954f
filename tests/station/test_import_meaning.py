"""Units and signs by meaning: what contradicts heading, speed or places is named with its cure."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.messages import Fix, Frame, Heading, ImuBlock
from common.units import NS_PER_S
from shore.imports.meaning import Doubt, MeaningCheck
from tests.cases import CASES, needs_cases
from tests.station.imports import Importer

FIRST = CASES / "first-contact"


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Importer:
    return Importer(tmp_path, capsys)


@needs_cases
def test_yaw_rate_in_rad(importer: Importer) -> None:
    imported = importer(FIRST / "yaw-rate-in-rad.csv", "--map", str(FIRST / "yaw-rate-in-rad-map.toml"))
    (note,) = imported.summary["notes"]
    assert "is it in rad/s? Cure: yaw_rate_scale = 57.29578" in note


@needs_cases
def test_imu_upside_down(importer: Importer) -> None:
    imported = importer(FIRST / "imu-upside-down.csv", "--map", str(FIRST / "yaw-rate-in-rad-map.toml"))
    yaw, starboard = imported.summary["notes"]
    assert yaw.endswith("Cure: yaw_rate_scale = -1")
    assert starboard.endswith("Cure: accel_stb_scale = -1")


def voyage(seed: int, **factors: float) -> list[Doubt]:
    """What is doubted of 200 s at 2 to 3 m/s with turns of 40 deg and noise; factors: of a quantity as it is said."""
    draw = np.random.default_rng(seed)
    t_s = np.arange(0.0, 200.0, 0.1)
    rate_deg_s = 4.0 * np.sign(np.sin(t_s / 17.0 + draw.uniform(0, 6))) * (np.sin(t_s / 7.0) > 0)
    heading_deg = draw.uniform(0, 360) + np.cumsum(rate_deg_s) * 0.1
    speed = 2.5 + 0.5 * np.sin(t_s / 4.0)
    east = np.cumsum(speed * np.sin(np.radians(heading_deg))) * 0.1
    north = np.cumsum(speed * np.cos(np.radians(heading_deg))) * 0.1
    said = {
        "accel_fwd": np.gradient(speed, t_s) + draw.normal(0.05, 0.1, len(t_s)),
        "accel_stb": speed * np.radians(rate_deg_s) + draw.normal(-0.05, 0.1, len(t_s)),
        "yaw_rate": rate_deg_s + draw.normal(0.3, 0.3, len(t_s)),
        "heading": heading_deg + draw.normal(2.0, 1.0, len(t_s)),
        "sog": (speed + draw.normal(0, 0.05, len(t_s))) * 3600 / 1852,
    }
    said = {name: values * factors.get(name, 1.0) for name, values in said.items()}
    times = [round(second * NS_PER_S) for second in t_s]
    noise = draw.normal(0.0, 0.8, (2, len(t_s)))
    fixes = [
        Fix(sensor="gps1", t_ns=times[k], lat_deg=50 + (north[k] + noise[0, k]) / 111_195, fix_quality=1,
            lon_deg=(east[k] + noise[1, k]) / 111_195 / math.cos(math.radians(50)), sog_kn=float(said["sog"][k]))
        for k in range(0, len(t_s), 10)
    ]  # fmt: skip
    headings = [
        Heading(sensor="compass1", t_ns=time, heading_true_deg=float(value) % 360.0)
        for time, value in zip(times, said["heading"], strict=True)
    ]
    fwd, stb, rate = (tuple(map(float, said[name])) for name in ("accel_fwd", "accel_stb", "yaw_rate"))
    imu = ImuBlock(
        sensor="imu1",
        t_ns=times[0],
        offset_us=tuple(time // 1000 for time in times),
        accel_fwd_m_s2=fwd,
        accel_stb_m_s2=stb,
        yaw_rate_deg_s=rate,
    )
    check = MeaningCheck()
    boat = {"boat_id": "b", "boot_id": "0" * 16, "clock_id": "c"}
    own = {"fixes": tuple(fixes), "headings": tuple(headings), "imu": (imu,)}
    check.take(Frame(**boat, seq=0, start_no=1, t0_ns=0, t1_ns=times[-1], **own))  # type: ignore[arg-type]
    return check.doubts()


@given(st.integers(0, 10_000))
@settings(max_examples=15)
def test_a_healthy_voyage_is_not_doubted(seed: int) -> None:
    assert voyage(seed) == []


@pytest.mark.parametrize(
    ("name", "said", "key", "factor"),
    [
        ("yaw_rate", 1 / 57.29578, "yaw_rate_scale", 57.29578), ("yaw_rate", 57.29578, "yaw_rate_scale", 1 / 57.29578),
        ("yaw_rate", -1.0, "yaw_rate_scale", -1.0), ("yaw_rate", 60.0, "yaw_rate_scale", 1 / 60),
        ("accel_fwd", 1 / 9.80665, "accel_scale", 9.80665), ("accel_fwd", 9.80665, "accel_scale", 1 / 9.80665),
        ("accel_fwd", -1.0, "accel_scale", -1.0), ("accel_stb", 1 / 9.80665, "accel_stb_scale", 9.80665),
        ("sog", 0.514444, "sog_scale", 1.943844), ("sog", 1.852, "sog_scale", 0.5399568),
        ("heading", 1 / 57.29578, "scale", 57.29578), ("heading", -1.0, "scale", -1.0),
    ],
)  # fmt: skip
def test_a_wrong_unit_or_sign_is_named(name: str, said: float, key: str, factor: float) -> None:
    for seed in range(3):
        found = {doubt.key: doubt.factor for doubt in voyage(seed, **{name: said})}
        assert found[key] == pytest.approx(factor, rel=1e-5), seed
        # A wrong heading makes what is measured by it wrong too.
        assert name == "heading" or len(found) == 1, seed


def test_a_gyro_that_never_changes_is_named() -> None:
    assert voyage(1, yaw_rate=0.0)[-1].text.startswith("yaw_rate is 0 in all 2000 samples")


@pytest.mark.parametrize(
    ("lat", "lon", "guess"),
    [
        ("north", "-east", "longitude the wrong sign"), ("-north", "east", "latitude the wrong sign"),
        ("east", "north", "swapped"),
    ],
)  # fmt: skip
def test_a_mirrored_map_is_named(lat: str, lon: str, guess: str, importer: Importer) -> None:
    draw = np.random.default_rng(3)
    course = 120.0 + 30.0 * np.sin(np.arange(120) / 20.0)
    way = {
        "east": np.cumsum(2.5 * np.sin(np.radians(course))) / 111_195,
        "north": np.cumsum(2.5 * np.cos(np.radians(course))) / 111_195,
    }
    way |= {f"-{name}": -values for name, values in way.items()}
    text = "t,lat,lon,cog\n" + "".join(
        f"{1.7e9 + k},{way[lat][k]:.7f},{way[lon][k]:.7f},{course[k] + draw.normal(0, 3):.1f}\n" for k in range(120)
    )
    (importer.directory / "map.toml").write_text(
        '[boat]\nid = "b"\n[time]\ncolumn = "t"\nunix = true\n[fix]\nlat = "lat"\nlon = "lon"\ncog = "cog"\n'
    )
    imported = importer.text(text, "--map", str(importer.directory / "map.toml"), name="in.csv")
    (note,) = imported.summary["notes"]
    assert guess in note
