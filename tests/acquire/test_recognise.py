from common.boat_config import SensorTable
from onboard.devices import MODELS, Line
from onboard.devices.recognise import accepted_by_model, heard_by, recognised, recognised_by_role

TCM2 = b"$C309.8P4.0R-2.9T25.1*03"
HEADING = b"$HCHDG,101.1,,,,*43"
AIS = b"!AIVDM,1,1,,A,B3KLehP0B@LTN6`Vl;rrBE063P06,0*5A"


def lines(*data: bytes) -> list[Line]:
    return [Line(number * 1_000_000_000, item) for number, item in enumerate(data)]


def test_most_good_lines_decide_and_the_first_model_of_the_table_among_equals() -> None:
    assert recognised(lines(TCM2, TCM2, AIS)) == ("compass", "tcm2")
    assert recognised(lines(TCM2, AIS, AIS)) == ("ais", "nmea")
    counts = accepted_by_model(lines(HEADING))
    assert set(counts.values()) == {1}
    assert len(counts) > 1
    assert recognised(lines(HEADING)) == next(iter(counts)) == ("compass", "nmea")
    assert list(counts) == [key for key in MODELS if key in counts]


def test_each_role_has_a_model_of_its_own() -> None:
    found = recognised_by_role(lines(AIS, TCM2, HEADING, HEADING))
    assert list(found.items()) == [("compass", "nmea"), ("ais", "nmea")]  # in the order of ROLES
    assert recognised_by_role(lines(AIS, TCM2, TCM2, HEADING)) == {"compass": "tcm2", "ais": "nmea"}


def test_nothing_is_recognised_in_nothing() -> None:
    assert recognised([]) is None
    assert recognised_by_role(lines(b"hello", b"\xff\xfe")) == {}


def test_of_sensors_on_one_port_the_first_that_claims_a_line_has_it() -> None:
    first = SensorTable(id="compass1", port="p", role="compass")
    second = SensorTable(id="compass2", port="p", role="compass")
    heard = heard_by([first, second], lines(HEADING, HEADING, AIS))
    assert heard.accepted == {"compass1": 2}
    assert heard.measured == {"compass1": 2}


def test_a_fix_counts_once_its_epoch_is_over_and_what_comes_along_with_it_does_not() -> None:
    gga = b"$GPGGA,172814.0,3723.46587704,N,12202.26957864,W,2,6,1.2,18.893,M,-25.669,M,2.0,0031*4F"
    heard = heard_by([SensorTable(id="gps1", port="p", role="gps")], lines(gga))
    assert heard.accepted == {"gps1": 1}
    assert heard.measured == {"gps1": 1}
