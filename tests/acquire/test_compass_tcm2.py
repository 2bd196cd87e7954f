"""PNI TCM2: output words with any group switched off, error codes, mils, and its NMEA output."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages import Attitude, Heading
from onboard.devices import Accepted, Ignored, PortDecoder, Rejected, make_driver
from tests.acquire.sentences import MS, compass, heading, line, measured, recording, sealed

MANUAL = b"$C328.3P28.4R-12.4X55.11Y12.33Z-18.43T22.3E001*29"


def tcm2(body: str) -> object:
    driver = make_driver(compass(model="tcm2"))
    assert driver.claims(line(sealed(body)))
    return driver.feed(line(sealed(body)))


def test_the_example_of_the_manual() -> None:
    driver = make_driver(compass(model="tcm2", latency_ms=20))
    outcome = driver.feed(line(MANUAL, 100 * MS))
    found = heading(outcome)
    assert found.field_ut == pytest.approx(math.sqrt(55.11**2 + 12.33**2 + 18.43**2))
    wanted = Heading(
        sensor="compass1", t_ns=80 * MS, heading_mag_deg=328.3, pitch_deg=28.4, roll_deg=-12.4,
        field_ut=found.field_ut, temperature_c=22.3, warning="E001",
    )  # fmt: skip
    assert outcome == Accepted("compass1", "TCM2", (wanted,))
    assert driver.flush(10**18, 0) == ()


@pytest.mark.parametrize(
    ("body", "fields"),
    [
        ("C309.8", {"heading_mag_deg": 309.8}),
        ("C360.0", {"heading_mag_deg": 0.0}),
        ("C0.0R-2.9", {"heading_mag_deg": 0.0, "roll_deg": -2.9}),
        ("C309.8T25.1", {"heading_mag_deg": 309.8, "temperature_c": 25.1}),
        # Two axes give no strength; 77 is Fahrenheit.
        ("C309.8X55.11Y12.33", {"heading_mag_deg": 309.8}),
        ("C309.8T77.0", {"heading_mag_deg": 309.8}),
        ("C309.8X3.0Y4.0Z-12.0", {"heading_mag_deg": 309.8, "field_ut": 13.0}),
        ("C309.8E000", {"heading_mag_deg": 309.8}),
        ("C309.8E400", {"heading_mag_deg": 309.8, "warning": "E400"}),
        ("C309.8P-1.0EC01", {"heading_mag_deg": 309.8, "pitch_deg": -1.0, "warning": "EC01"}),
    ],
)
def test_groups_may_be_absent(body: str, fields: dict[str, float | str]) -> None:
    found = heading(make_driver(compass(model="tcm2")).feed(line(sealed(body))))
    assert found == Heading(sensor="compass1", t_ns=0, **fields)  # type: ignore[arg-type]


def test_without_heading_it_is_an_attitude() -> None:
    found = measured(make_driver(compass(model="tcm2")).feed(line(sealed("P4.0R-2.9T25.1E001"))))
    assert found == (Attitude(sensor="compass1", t_ns=0, pitch_deg=4.0, roll_deg=-2.9, warning="E001"),)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("C360.1", "range"),
        ("C4480", "range"),
        ("C90", "unit"),
        ("C-0.1", "range"),
        ("C90.0P4R-2.9", "unit"),
        ("C90.0R-2", "unit"),
        ("C90.0P90.1", "range"),
        ("C90.0R180.1", "range"),
        ("C90.0X1000.1", "range"),
        ("C90.0PR1.0", "not-a-number"),
        ("C90.0P-", "not-a-number"),
        ("C90.", "not-a-number"),
        ("C9.0.0", "not-a-number"),
        ("C90.0T2-1", "not-a-number"),
        ("C90.0R1.0P1.0", "fields"),
        ("C90.0C90.0", "fields"),
        ("C90.0E01", "fields"),
        ("C90.0E0011", "fields"),
        ("C90.0E00G", "fields"),
        ("C90.0Q1", "fields"),
        ("C90.0,", "fields"),
        ("T25.1", "empty"),
        ("X1.0Y2.0Z3.0T25.1", "empty"),
        ("C309.8P4.0R-2.9E002", "alarm"),
        ("C309.8P4.0R-2.9E004", "alarm"),
        ("C309.8P4.0R-2.9EC06", "alarm"),
        ("P4.0E002", "alarm"),
    ],
)
def test_refusals(body: str, reason: str) -> None:
    assert tcm2(body) == Rejected(reason, "compass1")


def test_the_checksum_is_required_and_prompts_are_passed_over() -> None:
    port = PortDecoder([make_driver(compass(model="tcm2"))])
    assert port.feed(line(b"$C309.8P4.0R-2.9T25.1*03")) != Rejected("checksum", "compass1")
    assert port.feed(line(b"$C309.9P4.0R-2.9T25.1*03")) == Rejected("checksum", "compass1")
    assert port.feed(line(b"$C4480")) == Rejected("no-checksum", "compass1")
    assert port.feed(line(b"$C309.8$C309.8P4.0R-2.9T25.1*03")) == Rejected("run-together", "compass1")
    assert port.feed(line(b":")) == Ignored("text")


def test_bytes_of_a_wrong_baud_rate_before_a_whole_word_do_no_harm() -> None:
    driver = make_driver(compass(model="tcm2"))
    noisy = line(b"\x80\xfe" + MANUAL)
    assert driver.claims(noisy)
    assert heading(driver.feed(noisy)).heading_mag_deg == 328.3


def test_its_nmea_output() -> None:
    driver = make_driver(compass(model="tcm2", talkers=("HC",)))
    assert driver.claims(line(MANUAL))
    assert heading(driver.feed(line(sealed("HCHDM,182.3,M")))).heading_mag_deg == 182.3
    assert not driver.claims(line(sealed("IIHDM,182.3,M")))


def test_recorded_words() -> None:
    driver = make_driver(compass(model="tcm2"))
    lines = recording("serial-snippets/avalon_test_compass.txt").split()
    found = [heading(driver.feed(line(data))) for data in lines]
    assert [one.heading_mag_deg for one in found] == [309.8, 310.2, 310.5, 310.5, 310.5, 310.4, 310.2, 310.3, 310.3]
    assert [one.pitch_deg for one in found] == [4.0, 4.2, 4.4, 4.4, 4.6, 4.6, 4.6, 4.6, 4.4]
    assert [one.roll_deg for one in found] == [-2.9, -2.6, -2.2, -2.0, -2.0, -2.0, -2.2, -2.0, -1.8]
    assert {one.temperature_c for one in found} == {25.0, 25.1}


@given(
    st.integers(0, 3599).map(lambda value: value / 10),
    *[st.none() | st.integers(-900, 900).map(lambda value: value / 10)] * 2,
    st.none() | st.tuples(*[st.integers(-9999, 9999).map(lambda value: value / 100)] * 3),
)
def test_round_trip(
    value: float, pitch: float | None, roll: float | None, field: tuple[float, float, float] | None
) -> None:
    groups = [("C", value), ("P", pitch), ("R", roll), *zip("XYZ", field or (), strict=False)]
    body = "".join(f"{tag}{number}" for tag, number in groups if number is not None)
    found = heading(make_driver(compass(model="tcm2")).feed(line(sealed(body))))
    assert (found.heading_mag_deg, found.pitch_deg, found.roll_deg) == (value, pitch, roll)
    strength = None if field is None else sum(axis**2 for axis in field) ** 0.5
    assert found.field_ut == (pytest.approx(strength) if strength else None)
