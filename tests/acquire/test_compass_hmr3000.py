"""Honeywell HMR3000: PTNTHPR beside HDG, HDT and XDR; True North's PTNTHTM is refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages import Attitude, Heading
from onboard.devices import Accepted, Ignored, Line, PortDecoder, Rejected, make_driver
from tests.acquire.sentences import MS, S, compass, heading, line, measured, recording, sealed

HPR = b"$PTNTHPR,354.9,N,5.2,N,0.2,N*3A"


def hmr(body: str) -> object:
    return make_driver(compass(model="hmr3000")).feed(line(sealed(body)))


def test_heading_pitch_and_roll() -> None:
    driver = make_driver(compass(model="hmr3000", latency_ms=20, talkers=("HC",)))
    assert driver.claims(line(HPR))
    wanted = Heading(sensor="compass1", t_ns=80 * MS, heading_mag_deg=354.9, pitch_deg=5.2, roll_deg=0.2)
    assert driver.feed(line(HPR, 100 * MS)) == Accepted("compass1", "PTNTHPR", (wanted,))


@pytest.mark.parametrize(
    ("body", "warning"),
    [
        ("PTNTHPR,354.9,M,5.2,N,-0.2,N", "heading M"),
        ("PTNTHPR,354.9,N,5.2,O,-0.2,M", "pitch O, roll M"),
        ("PTNTHPR,354.9,C,5.2,N,-0.2,N", "heading C"),
    ],
)
def test_warnings_travel_in_the_letters_of_the_device(body: str, warning: str) -> None:
    found = heading(make_driver(compass(model="hmr3000")).feed(line(sealed(body))))
    assert (found.heading_mag_deg, found.roll_deg, found.warning) == (354.9, -0.2, warning)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("PTNTHPR,,P,5.2,N,0.2,N", "alarm"),
        ("PTNTHPR,,N,,P,0.2,N", "alarm"),
        ("PTNTHPR,,N,5.2,N,,L", "alarm"),
        ("PTNTHPR,,C,5.2,N,0.2,N", "alarm"),
        ("PTNTHPR,354.9,N,5.2,P,0.2,N", "alarm"),
        ("PTNTHPR,,N,5.2,N,0.2,N", "empty"),
        ("PTNTHPR,90,N,29,N,15,N", "unit"),
        ("PTNTHPR,354.9,N,29,N,0.2,N", "unit"),
        ("PTNTHPR,354.9,N,5.2,N,15,N", "unit"),
        ("PTNTHPR,6399,N,29,N,15,N", "unit"),
        ("PTNTHPR,360.1,N,5.2,N,0.2,N", "range"),
        ("PTNTHPR,-5.9,N,-0.9,N,0.8,N", "range"),
        ("PTNTHPR,354.9,N,90.1,N,0.2,N", "range"),
        ("PTNTHPR,354.9,N,5.2,N,-180.1,N", "range"),
        ("PTNTHPR,354.9,Q,5.2,N,0.2,N", "status"),
        ("PTNTHPR,354.9,N,5.2,,0.2,N", "status"),
        ("PTNTHPR,354.9,n,5.2,N,0.2,N", "status"),
        ("PTNTHPR,354.9,N,5.2,N,0.2", "fields"),
        ("PTNTHPR,354.9,N,5.2,N,0.2,N,", "fields"),
        ("PTNTHPR,35x.9,N,5.2,N,0.2,N", "not-a-number"),
        ("PTNTHTM,14223,N,169,N,-43,N,13641,2454", "range"),
        ("PTNTHTM,223,N,169,N,-43,N,13641,2454", "unit"),
        ("PTNTHTM,223.0,N,1.9,N,-4.3,N,13.1,24.4", "unit"),
        ("PTNTHTM,223,N,169,N,-43,N,13641", "fields"),
    ],
)
def test_refusals(body: str, reason: str) -> None:
    assert hmr(body) == Rejected(reason, "compass1")


def test_mils_of_the_manual_are_refused() -> None:
    driver = make_driver(compass(model="hmr3000"))
    assert driver.feed(line(b"$PTNTHPR,90,N,29,N,15,N*1C")) == Rejected("unit", "compass1")


def test_all_sentences_of_one_reading_are_one_heading_with_its_attitude() -> None:
    driver = make_driver(compass(model="hmr3000"))
    bodies = ("HCHDG,85.8,,,,", "HCHDT,,T", "PTNTHPR,85.8,N,5.2,N,0.2,N", "HCXDR,A,5.2,D,PITCH,A,0.2,D,ROLL")
    kinds = []
    for reading in range(4):
        outcomes = [driver.feed(Line(reading * S + n * MS, sealed(body))) for n, body in enumerate(bodies)]
        assert all(isinstance(outcome, Accepted) for outcome in outcomes), outcomes
        kinds.append([type(one).__name__ for outcome in outcomes for one in measured(outcome)])
    # First HDG, because it came first, and HPR adds the attitude; then HPR alone.
    assert kinds == [["Heading", "Attitude"], ["Heading", "Attitude"], ["Heading"], ["Heading"]]


def test_attitude_beside_a_heading_of_another_sentence_keeps_the_warning() -> None:
    driver = make_driver(compass(model="hmr3000"))
    heading(driver.feed(line(b"$HCHDG,85.8,0.0,E,0.0,E*77")))
    wanted = Attitude(sensor="compass1", t_ns=1000, pitch_deg=5.2, roll_deg=0.2, warning="heading O")
    assert measured(driver.feed(line(sealed("PTNTHPR,85.8,O,5.2,N,0.2,N"), 1000))) == (wanted,)


def test_nothing_is_left_of_it_where_others_give_heading_and_attitude() -> None:
    driver = make_driver(compass(model="hmr3000"))
    assert driver.feed(line(sealed("PTNTHPR,85.8,N,,N,,N"))) == Accepted(
        "compass1", "PTNTHPR", (Heading(sensor="compass1", t_ns=0, heading_mag_deg=85.8),)
    )
    driver = make_driver(compass(model="hmr3000"))
    heading(driver.feed(line(sealed("HCHDG,85.8,,,,"))))
    assert measured(driver.feed(line(sealed("PTNTHPR,85.8,N,,N,,N")))) == ()
    assert len(measured(driver.feed(line(sealed("HCXDR,A,5.2,D,PITCH"))))) == 1
    assert measured(driver.feed(line(sealed("PTNTHPR,85.8,N,5.2,N,0.2,N"), 3 * S))) != ()
    heading(driver.feed(line(sealed("HCHDG,85.8,,,,"), 6 * S)))
    assert len(measured(driver.feed(line(sealed("HCXDR,A,5.2,D,PITCH"), 6 * S)))) == 1
    assert measured(driver.feed(line(sealed("PTNTHPR,85.8,N,5.2,N,0.2,N"), 6 * S))) == ()


@pytest.mark.parametrize(
    ("before", "mag", "true", "deviation", "variation"),
    [
        ("HCHDG,85.8,,,,", 354.9, None, None, None),
        ("HCHDG,85.8,0.0,E,0.0,E", 354.9, None, None, None),
        ("HCHDG,85.8,1.0,E,,", 353.9, None, 1.0, None),
        ("HCHDG,85.8,,,12.2,W", 7.1, None, None, -12.2),
        ("HCHDG,85.8,1.0,E,12.2,W", 6.1, None, 1.0, -12.2),
        ("HCHDT,86.2,T", None, 354.9, None, None),
        ("HCHDT,,T", 354.9, None, None, None),
        # Another device on the same port says nothing about this one.
        ("GPHDT,86.2,T", 354.9, None, None, None),
        ("IIHDG,85.8,,,12.2,W", 354.9, None, None, None),
    ],
)
def test_what_is_programmed_in_the_device_is_taken_off_its_own_heading(
    before: str, mag: float | None, true: float | None, deviation: float | None, variation: float | None
) -> None:
    """A variation that only an HDT betrays leaves it a true heading."""
    driver = make_driver(compass(model="hmr3000"))
    driver.feed(line(sealed(before)))
    found = heading(driver.feed(line(HPR, 3 * S)))
    assert (found.heading_mag_deg, found.heading_true_deg) == (mag, true)
    assert (found.deviation_deg, found.variation_deg) == (deviation, variation)


def test_raw_counts_are_not_claimed() -> None:
    port = PortDecoder([make_driver(compass(model="hmr3000"))])
    assert port.feed(line(sealed("PTNTRCD,1509,1551,1548,1553,15199"))) == Ignored("PTNTRCD")
    assert port.feed(line(HPR[:-1] + b"B")) == Rejected("checksum", "compass1")


def test_true_north_revolution_is_refused_for_its_range() -> None:
    driver = make_driver(compass(model="hmr3000"))
    lines = [data for data in recording("gpsd-receivers/tnt-revolution.log").splitlines() if data.startswith(b"$")]
    outcomes = [driver.feed(line(data)) for data in lines if driver.claims(line(data))]
    assert len(outcomes) == len(lines) == 60
    assert set(outcomes) == {Rejected("range", "compass1")}


ANGLE = st.integers(-900, 900).map(lambda value: value / 10)


@given(st.integers(0, 3599).map(lambda value: value / 10), ANGLE, ANGLE, st.sampled_from("NMO"))
def test_round_trip(value: float, pitch: float, roll: float, letter: str) -> None:
    data = sealed(f"PTNTHPR,{value:.1f},{letter},{pitch:.1f},N,{roll:.1f},N")
    found = heading(make_driver(compass(model="hmr3000")).feed(line(data)))
    assert (found.heading_mag_deg, found.pitch_deg, found.roll_deg) == (value, pitch, roll)
    assert found.warning == (None if letter == "N" else f"heading {letter}")
