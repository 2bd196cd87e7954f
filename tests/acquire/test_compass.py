"""Compasses that speak NMEA: HDG, HDM, HDT, HCC, ROT and XDR with their oddities; one value at an instant."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.framer import Measurement
from common.messages import Attitude, Heading, TurnRate
from onboard.devices import Accepted, Ignored, Line, PortDecoder, Rejected, make_driver
from tests.acquire.sentences import MS, S, compass, heading, line, measured, recording, sealed
from tests.cases import CASES, needs_cases

MODELS = ("nmea", "hsc100", "tcm2", "hmr3000", "kvh-c100")


@pytest.mark.parametrize(
    ("data", "mag", "true", "deviation", "variation"),
    [
        (b"$HCHDG,85.8,0.0,E,0.0,E*77", 85.8, None, 0.0, 0.0),
        (b"$HCHDG,271.1,10.7,E,12.2,W*52", 271.1, None, 10.7, -12.2),
        (b"$HCHDG,123.4,,,,*46", 123.4, None, None, None),
        (b"$SDHDG,181.7,,,0.6,E*3C", 181.7, None, None, 0.6),
        (sealed("HCHDG,123.4,"), 123.4, None, None, None),
        (b"$HCHDT,86.2,T*15", None, 86.2, None, None),
        (sealed("HEHDT,123.4"), None, 123.4, None, None),
        (sealed("HCHDT,123.4,T,"), None, 123.4, None, None),
        (b"$HCHDM,123.4,M*2D", 123.4, None, None, None),
        (sealed("HCHDM,123.4,M,"), 123.4, None, None, None),
        (b"$APHDM,218.598,M*3C", 218.598, None, None, None),
        (sealed("HCHCC,123.4"), 123.4, None, None, None),
        (sealed("HCHDM,360.0,M"), 0.0, None, None, None),
        (sealed("HCHDT,0.0,T"), None, 0.0, None, None),
    ],
)
def test_headings(
    data: bytes, mag: float | None, true: float | None, deviation: float | None, variation: float | None
) -> None:
    driver = make_driver(compass())
    assert driver.claims(line(data))
    found = heading(driver.feed(line(data)))
    assert (found.heading_mag_deg, found.heading_true_deg) == (mag, true)
    assert (found.deviation_deg, found.variation_deg) == (deviation, variation)
    assert (found.pitch_deg, found.roll_deg, found.warning) == (None, None, None)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("HCHDG,,0.0,E,0.0,E", "empty"),
        ("HCHDG,,,,,", "empty"),
        ("HCHDG,123.4", "fields"),
        ("HCHDG,123.4,5", "hemisphere"),
        ("HCHDG,123.4,,", "fields"),
        ("HCHDG,123.4,,,", "fields"),
        ("HCHDT,,T", "empty"),
        ("HCHDM,,M", "empty"),
        ("HCHCC,", "empty"),
        ("HCHCC,123.4,M", "fields"),
        ("HCHDM,123.4,T", "unit"),
        ("HCHDT,123.4,M", "unit"),
        ("HCHDM,123.4,M,5", "fields"),
        ("HCHDM,123.4,M,,", "fields"),
        ("HCHDT,123.4,T,5", "fields"),
        ("HCHDT,123.4,T,,", "fields"),
        ("HCHDT,abc,T", "not-a-number"),
        ("HCHDT,360.1,T", "range"),
        ("HEROT,,A", "empty"),
        ("HEROT,1.0,V", "void"),
        ("HEROT,,V", "void"),
        ("HEROT,1.0,", "status"),
        ("HEROT,1.0,X", "status"),
        ("HEROT,1.0", "fields"),
        ("HEROT,+-1.0,A", "range"),
        ("HEROT,++1.0,A", "not-a-number"),
        ("HEROT,21600.1,A", "range"),
        ("HEROT,-21600.1,A", "range"),
        ("HCXDR,A,,D,PITCH,A,,D,ROLL", "empty"),
        ("HCXDR,A,90.1,D,PITCH", "range"),
        ("HCXDR,A,-180.1,D,ROLL", "range"),
        (f"HCXDR,A,{'9' * 400},D,ROLL", "range"),
        ("HCXDR,A,1.0,R,PITCH", "unit"),
        ("HCXDR,C,1.0,D,PITCH", "unit"),
        ("HCXDR,A,1.0,,PITCH", "unit"),
        ("HCXDR,A,1.0,D,PITCH,A,2.0,D,PTCH", "duplicate"),
        ("HCXDR,A,1.0,D,PITCH,A", "fields"),
        ("HCXDR,A,1.0,D,PITCH" + ",G,1,,MAGX" * 10, "fields"),
        ("HCXDR,A,-1.-7,D,HEEL", "not-a-number"),
        ("HCXDR,A,1.0,D,PITCH,C,-4.-2,C,AIRTEMP", "not-a-number"),
        ("HCXDR,A,nan,D,PITCH", "not-a-number"),
    ],
)
def test_refusals_count_for_the_compass(body: str, reason: str) -> None:
    driver = make_driver(compass())
    assert driver.claims(line(sealed(body)))
    assert driver.feed(line(sealed(body))) == Rejected(reason, "compass1")


@pytest.mark.parametrize("model", MODELS)
def test_every_other_model_needs_the_checksum(model: str) -> None:
    driver = make_driver(compass(model=model))
    sentence = b"$HCHDT,86.2,T" if model == "hmr3000" else b"$HCHDM,86.2,M"
    assert driver.claims(line(sentence))
    assert driver.feed(line(sentence)) == Rejected("no-checksum", "compass1")
    assert driver.feed(line(sentence + b"*00")) == Rejected("checksum", "compass1")


def test_latency_is_subtracted_and_whole_microseconds_remain() -> None:
    driver = make_driver(compass(latency_ms=12.3456))
    assert heading(driver.feed(line(b"$HCHDT,86.2,T*15", 100 * MS))).t_ns == 87_654_000
    (rate,) = measured(driver.feed(line(sealed("HEROT,6.0,A"), 100 * MS)))
    (attitude,) = measured(driver.feed(line(sealed("HCXDR,A,1.0,D,PITCH"), 100 * MS)))
    assert rate.t_ns == attitude.t_ns == 87_654_000
    assert driver.flush(10**18, 0) == ()


def test_talker_filter() -> None:
    driver = make_driver(compass(talkers=("HC",)))
    assert driver.claims(line(b"$HCHDT,86.2,T*15"))
    assert not driver.claims(line(sealed("IIHDT,86.2,T")))
    assert driver.claims(line(sealed("HCXDR,A,1.0,D,PITCH")))
    assert not driver.claims(line(sealed("YXXDR,A,1.0,D,PITCH")))


@pytest.mark.parametrize(
    ("model", "claimed"),
    [
        ("nmea", "HDG HDM HDT HCC ROT XDR"),
        ("hsc100", "HDG HDM HDT HCC ROT"),
        ("tcm2", "HDM TCM2"),
        ("hmr3000", "HDG HDT XDR HPR HTM"),
        ("kvh-c100", "HDG HDM HDT KVH KVH1"),
    ],
)
def test_what_each_model_claims(model: str, claimed: str) -> None:
    lines = {
        "HDG": b"$HCHDG,123.4,,,,*46", "HDM": b"$HCHDM,123.4,M*2D", "HDT": b"$HCHDT,86.2,T*15",
        "HCC": b"$HCHCC,1.0*00", "ROT": b"$HEROT,0.0,A*2B", "XDR": b"$APXDR,A,0.135,D,PTCH*7C",
        "weather": b"$WIXDR,C,10.7,C,AIRTEMP*00", "roller": b"$WIXDR,C,10.7,C,ROLLER*00",
        "TCM2": b"$C309.8P4.0R-2.9T25.1*03", "query": b"$CCGPQ,GGA*2B", "C1": b"$C1RMC,1*00",
        "HPR": b"$PTNTHPR,354.9,N,5.2,N,0.2,N*3A", "HTM": b"$PTNTHTM,14223,N,169,N,-43,N,13641,2454*15",
        "RCD": b"$PTNTRCD,1509,1551,1548*00", "KVH": b"%0000,0000,1234", "KVH1": b"%123.4", "prompt": b":",
        "RMC": b"$GPRMC,,V,,,,,,,,,,N*53",
    }  # fmt: skip
    driver = make_driver(compass(model=model))
    assert {name for name, data in lines.items() if driver.claims(line(data))} == set(claimed.split())


def test_what_weather_stations_send_stays_with_nobody() -> None:
    port = PortDecoder([make_driver(compass(model=model, id=f"compass{n}")) for n, model in enumerate(MODELS)])
    assert port.feed(line(sealed("WIXDR,C,10.7,C,AIRTEMP,P,1.026,B,BARO"))) == Ignored("XDR")


@pytest.mark.parametrize(
    ("text", "rate_deg_s"),
    [("6.0", 0.1), ("-6.0", -0.1), ("+6.0", 0.1), ("0.0", 0.0), ("-0.007", -0.007 / 60), ("7200", 120.0)],
)
def test_rate_of_turn_is_per_second_and_starboard_positive(text: str, rate_deg_s: float) -> None:
    (found,) = measured(make_driver(compass(model="hsc100")).feed(line(sealed(f"HEROT,{text},A"))))
    assert isinstance(found, TurnRate)
    assert (found.sensor, found.t_ns) == ("compass1", 0)
    assert found.rate_deg_s == pytest.approx(rate_deg_s, abs=1e-12)


@pytest.mark.parametrize(
    ("data", "pitch", "roll"),
    [
        (b"$APXDR,A,0.135,D,PTCH*7C", 0.135, None),
        (b"$APXDR,A,3.861,D,ROLL*65", None, 3.861),
        (sealed("IIXDR,A,-2.5,D,HEEL"), None, -2.5),
        (sealed("HCXDR,A,5.2,D,PITCH,A,-0.2,D,ROLL,G,1.0,,MAGX,G,-2,,MAGY,G,3,,MAGZ,G,4,,MAGT"), 5.2, -0.2),
        (sealed("HCXDR,G,1.0,,MAGX,A,-0.2,D,ROLL,C,21.5,C,AIRTEMP,A,5.2,D,PITCH"), 5.2, -0.2),
        (sealed("HCXDR,A,,D,PITCH,A,-0.2,D,ROLL,G,,,MAGX"), None, -0.2),
        (sealed("HCXDR,A,90.0,D,PITCH,A,-180,D,ROLL"), 90.0, -180.0),
    ],
)
def test_pitch_and_roll_of_xdr(data: bytes, pitch: float | None, roll: float | None) -> None:
    driver = make_driver(compass())
    assert driver.claims(line(data))
    wanted = Attitude(sensor="compass1", t_ns=0, pitch_deg=pitch, roll_deg=roll)
    assert driver.feed(line(data)) == Accepted("compass1", "XDR", (wanted,))


HDG, HDM, HDT = b"$HCHDG,271.1,10.7,E,12.2,W*52", b"$HCHDM,123.4,M*2D", b"$HCHDT,86.2,T*15"


def kept(arrivals: list[tuple[float, bytes]]) -> list[tuple[float, str]]:
    """Of lines at times (s), those that gave a heading, as time and formatter; all must be accepted."""
    driver = make_driver(compass())
    outcomes = [(t_s, driver.feed(Line(round(t_s * S), data))) for t_s, data in arrivals]
    assert all(isinstance(outcome, Accepted) for _, outcome in outcomes)
    return [(t_s, outcome.kind) for t_s, outcome in outcomes if isinstance(outcome, Accepted) and outcome.measurements]


@pytest.mark.parametrize("order", [(HDG, HDM, HDT), (HDT, HDM, HDG), (HDM, HDT, HDG)])
def test_three_sentences_of_one_reading_are_one_heading(order: tuple[bytes, ...]) -> None:
    found = kept([(t + 0.05 * n, data) for t in range(10) for n, data in enumerate(order)])
    assert len(found) == 10
    assert [int(t_s) for t_s, _ in found] == list(range(10))
    # From the second reading on the one with deviation and variation is used, whatever came first.
    assert {kind for _, kind in found[2:]} == {"HDG"}


def test_a_rare_sentence_does_not_displace_a_frequent_one() -> None:
    arrivals = [(0.1 * n, HDM) for n in range(200)] + [(10.0 * n + 0.05, HDG) for n in range(2)]
    found = kept(sorted(arrivals))
    assert found == [(0.1 * n, "HDM") for n in range(200)]


def test_what_is_left_is_used_two_seconds_after_the_better_one_fell_silent() -> None:
    found = kept([(0.0, HDG), (0.1, HDT), (1.0, HDT), (2.0, HDT), (2.001, HDT), (3.0, HDT)])
    assert found == [(0.0, "HDG"), (2.001, "HDT"), (3.0, "HDT")]


def test_slow_sentences_alternate_at_their_own_instants_only() -> None:
    assert kept([(0.0, HDG), (0.1, HDT), (10.0, HDG), (10.1, HDT)]) == [(0.0, "HDG"), (10.0, "HDG")]


def test_the_same_sentence_repeated_by_another_talker_is_one_heading() -> None:
    found = kept([(0.1 * n, data) for n in range(10) for data in (HDM, sealed("IIHDM,123.4,M"))])
    assert len(found) == 10


def test_two_turn_rates_and_two_attitudes_of_one_instant_are_one() -> None:
    driver = make_driver(compass())
    sources = ("HEROT,6.0,A", "TIROT,6.0,A", "HCXDR,A,1.0,D,PITCH", "YXXDR,A,1.0,D,PITCH", "HCXDR,A,1.0,D,ROLL")
    found = [len(measured(driver.feed(line(sealed(body))))) for body in sources]
    assert found == [1, 0, 1, 0, 1]


def test_an_empty_sentence_beside_the_one_in_use_is_no_fault_and_alone_it_is() -> None:
    driver = make_driver(compass())
    empty = sealed("HCHDT,,T")
    assert driver.feed(line(empty)) == Rejected("empty", "compass1")
    assert isinstance(driver.feed(line(HDG)), Accepted)
    assert driver.feed(line(empty)) == Accepted("compass1", "HDT")
    assert driver.feed(line(empty, 2 * S + 1000)) == Rejected("empty", "compass1")
    # The one in use may not be empty.
    assert driver.feed(line(sealed("HCHDG,,,,,"), 1)) == Rejected("empty", "compass1")


def of_kind(name: str, **sensor: object) -> tuple[list[Measurement], dict[str, int]]:
    """All measurements of a recording by one compass, and the reasons of its refusals."""
    driver = make_driver(compass(**sensor))
    found: list[Measurement] = []
    refused: dict[str, int] = {}
    for number, data in enumerate(recording(name).splitlines()):
        if driver.claims(line(data)):
            outcome = driver.feed(line(data, number * MS))
            if isinstance(outcome, Accepted):
                found += outcome.measurements
            elif isinstance(outcome, Rejected):
                refused[outcome.reason] = refused.get(outcome.reason, 0) + 1
    return found, refused


def test_recorded_pypilot_and_saab() -> None:
    found, refused = of_kind("gpsd-receivers/pypilot.log")
    assert not refused
    assert {type(one) for one in found} == {Heading, TurnRate, Attitude}
    assert all(218 < one.heading_mag_deg < 219 for one in found if isinstance(one, Heading) and one.heading_mag_deg)
    found, refused = of_kind("gpsd-receivers/saab-r4.log")
    assert not refused
    assert len([one for one in found if isinstance(one, Heading)]) == 12
    assert {one.rate_deg_s for one in found if isinstance(one, TurnRate)} == {0.0}


def test_recorded_plotter_with_broken_numbers_gives_no_attitude() -> None:
    name = "radar-ttm-nmea/RadarLogs_lines_1-2000.txt"
    found, refused = of_kind(name, talkers=("II",))
    assert not [one for one in found if isinstance(one, Attitude)]
    # `$IIXDR,C,C,,C,AIRTEMP,A,-1.-7,D,HEEL,...`: a field too many, and numbers that are none.
    assert refused == {"fields": 57}


@pytest.mark.parametrize("model", MODELS)
@given(
    data=st.binary(max_size=600)
    | st.text(st.sampled_from("0123456789.,-CPRXYZTE*$%MNA"), max_size=60).map(
        lambda text: sealed(text.replace("$", "").replace("*", ""))
    )
    | st.text(st.sampled_from("0123456789.,-"), max_size=20).map(lambda text: b"%" + text.encode())
    | st.tuples(
        st.sampled_from(["PTNTHPR", "PTNTHTM", "HCXDR,A,1.0,D,PITCH", "HEROT", "HCHDG", "HCHDM", "HCHCC"]),
        st.text(st.sampled_from("0123456789.,-NMLPCAEWTD"), max_size=60),
    ).map(lambda parts: sealed(",".join(parts)))
)
def test_arbitrary_bytes_never_raise(model: str, data: bytes) -> None:
    driver = make_driver(compass(model=model))
    driver.claims(line(data))
    assert isinstance(driver.feed(line(data)), Accepted | Rejected)
    assert isinstance(PortDecoder([driver]).feed(line(data)), Accepted | Rejected | Ignored)


def tenths(low: int, high: int) -> st.SearchStrategy[float]:
    return st.integers(low, high).map(lambda value: value / 10)


@given(tenths(0, 3599), tenths(-1800, 1800), tenths(-1800, 1800), st.sampled_from(["HDG", "HDM", "HDT", "HCC"]))
def test_round_trip_of_headings(value: float, deviation: float, variation: float, formatter: str) -> None:
    def side(angle: float) -> str:
        return f"{abs(angle)},{'W' if angle < 0 else 'E'}"

    tail = {"HDG": f",{side(deviation)},{side(variation)}", "HDM": ",M", "HDT": ",T", "HCC": ""}[formatter]
    found = heading(make_driver(compass()).feed(line(sealed(f"HC{formatter},{value:05.1f}{tail}"))))
    assert (found.heading_true_deg if formatter == "HDT" else found.heading_mag_deg) == value
    if formatter == "HDG":
        assert (found.deviation_deg, found.variation_deg) == (deviation, variation)


@given(tenths(-9000, 9000), tenths(-900, 900), tenths(-1800, 1800))
def test_round_trip_of_rate_and_attitude(rate_deg_min: float, pitch: float, roll: float) -> None:
    driver = make_driver(compass())
    (rate,) = measured(driver.feed(line(sealed(f"HEROT,{rate_deg_min},A"))))
    assert isinstance(rate, TurnRate)
    assert rate.rate_deg_s * 60 == pytest.approx(rate_deg_min, abs=1e-9)
    (attitude,) = measured(driver.feed(line(sealed(f"HCXDR,A,{roll},D,ROLL,A,{pitch},D,PTCH"))))
    assert attitude == Attitude(sensor="compass1", t_ns=0, pitch_deg=pitch, roll_deg=roll)


def test_names_of_xdr_in_any_case() -> None:
    driver = make_driver(compass())
    data = sealed("YDXDR,A,-5.2,D,Yaw,A,1.2,D,Pitch,A,3.0,D,Roll")
    assert driver.claims(line(data))
    (attitude,) = measured(driver.feed(line(data)))
    assert isinstance(attitude, Attitude)
    assert (attitude.pitch_deg, attitude.roll_deg) == (1.2, 3.0)


def test_an_unknown_rate_of_turn_is_no_rate() -> None:
    assert make_driver(compass()).feed(line(sealed("TIROT,-9999.9,A"))) == Rejected("range", "compass1")


@needs_cases
def test_hdg_negative_variation() -> None:
    """Some autopilots write the sign and always E."""
    for data in (CASES / "board" / "hdg-negative-variation.nmea").read_bytes().splitlines():
        found = heading(make_driver(compass()).feed(line(data)))
        assert (found.heading_mag_deg, found.variation_deg) == (101.4, -16.9)


@needs_cases
def test_hdg_value_without_letter() -> None:
    """A zero needs no letter: it is no value."""
    for data in (CASES / "board" / "hdg-value-without-letter.nmea").read_bytes().splitlines():
        found = heading(make_driver(compass()).feed(line(data)))
        assert (found.heading_mag_deg, found.deviation_deg, found.variation_deg) == (101.4, None, None)


@pytest.mark.parametrize("variation", ["16.9,", "-16.9,W", "16.9,N"])
def test_a_variation_whose_sign_is_unknown_is_refused(variation: str) -> None:
    outcome = make_driver(compass()).feed(line(sealed(f"HCHDG,101.4,,,{variation}")))
    assert outcome == Rejected("hemisphere", "compass1")
