"""The guard around pynmea2: what is refused, under which word, and what is read from good sentences."""

from datetime import date

import pytest

from onboard.devices import nmea_parser as nmea
from onboard.devices.compass import sentences as compass_sentences
from onboard.devices.gps import sentences as gps_sentences
from onboard.devices.gps.sentences import Gga, Gll, Gsa, Rmc, Zda
from onboard.devices.nmea_fields import Position
from onboard.devices.nmea_sentence import Sentence, address, check_sentence
from tests.acquire.sentences import GGA, GSA, RMC, sealed

FORMS: dict[str, nmea.Form[object]] = {**gps_sentences.FORMS, **compass_sentences.NMEA}


def read(data: bytes) -> object:
    checked = check_sentence(data)
    return nmea.read(checked, FORMS) if isinstance(checked, Sentence) else checked


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "not-nmea"),
        (b"GPGGA,1*00", "not-nmea"),
        (b"$GPGGA\xff*00", "not-ascii"),
        (b"$GPGGA\x00*00", "not-ascii"),
        (b"$GPGGA,1", "no-checksum"),
        (GGA[:-1], "no-checksum"),
        (GGA[:-2] + b"7E", "checksum"),
        (GGA + b" x", "no-checksum"),
        (b"$" + b"1" * 512, "too-long"),
        (GGA[:30] + RMC, "run-together"),
        (GGA[30:] + RMC, "not-nmea"),
        (b"\xb5\x62\x01" + GGA[:-2] + b"7E", "checksum"),
        (b"\\s:GP0001*1C\\" + GGA[:-2] + b"7E", "checksum"),
        (b"\\s:GP0001*1C" + GGA, "not-nmea"),
        (sealed("GPGGA,$GPRMC"), "run-together"),
        (b"$GPRMC,0307$GPGGA,0307", "run-together"),
    ],
)
def test_refused_before_any_field(data: bytes, reason: str) -> None:
    assert check_sentence(data) == reason


@pytest.mark.parametrize(
    "before",
    [
        b"\\s:GP0001,c:1326055296*3C\\",
        b"\xb5\x62\x01\x20\x10\x00",
        b"\x00",
        b"12\xff,N",
        b"\xfd$",
        b"\xb5\x62$\x00$G!\x10xM",
    ],
)
def test_a_tag_block_or_binary_before_a_whole_sentence_is_not_part_of_it(before: bytes) -> None:
    assert check_sentence(before + GGA) == check_sentence(GGA)
    assert address(before + GGA) == ("GP", "GGA")


def test_blanks_behind_the_checksum_do_no_harm() -> None:
    assert check_sentence(GGA + b" \t\0") == check_sentence(GGA)


def test_lower_case_checksum_is_the_same_number() -> None:
    assert isinstance(check_sentence(GGA[:-2] + b"7d"), Sentence)


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (b"$GPGGA,1", ("GP", "GGA")),
        (b"!AIVDM,1", ("AI", "VDM")),
        (b"$GPGGA*00", ("GP", "GGA")),
        (b"$PSRFTXT,1", None),
        (b"$PASHR,1", None),
        (b"$CCGPQ,GGA*2B", ("CC", "GPQ")),
        (b"$04HDM,1", ("04", "HDM")),
        (b"$2WMWV,1", ("2W", "MWV")),
        (b"$GPgga,1", None),
        (b"$GPGGAX,1", None),
        (b"", None),
    ],
)
def test_address(data: bytes, found: tuple[str, str] | None) -> None:
    assert address(data) == found


GOOD = {
    "GGA": "GPGGA,030719.000,3747.0873,S,17518.8938,E,1,08,1.1,59.9,M,23.7,M,,0000",
    "RMC": "GPRMC,030719.000,A,3747.0873,S,17518.8938,E,0.69,181.39,311214,,,A",
    "VTG": "GPVTG,77.52,T,,M,0.004,N,0.008,K,A",
    "GNS": "GNGNS,112257.00,3844.24011,N,00908.43828,W,AN,03,10.5,,,,",
    "GLL": "GPGLL,5310.8115,N,00525.7025,E,195719,A,A",
    "ZDA": "GPZDA,195719,16,04,2014,-02,00",
    "HDG": "HCHDG,271.1,10.7,E,12.2,W",
    "GSA": "GPGSA,A,3,17,28,06,01,30,20,26,13,,,,,1.8,1.1,1.5",
}


@pytest.mark.parametrize(
    ("formatter", "old", "new", "reason"),
    [
        ("GGA", "3747.0873", "nan", "not-a-number"),
        ("GGA", "3747.0873", "1_0.5", "not-a-number"),
        ("GGA", "3747.0873", "3747.", "not-a-number"),
        ("GGA", "3747.0873", "747.0873", "not-a-number"),
        ("GGA", "3747.0873", "-747.0873", "not-a-number"),
        ("GGA", "3747.0873", "3760.0000", "range"),
        ("GGA", "3747.0873", "9000.0001", "range"),
        ("GGA", "17518.8938", "18000.0001", "range"),
        ("GGA", "17518.8938", "7518.8938", "not-a-number"),
        ("GGA", "17518.8938,E", ",E", "fields"),
        ("GGA", ",S,", ",E,", "hemisphere"),
        ("GGA", ",S,", ",,", "hemisphere"),
        ("GGA", ",S,", ",s,", "hemisphere"),
        ("GGA", ",E,", ",N,", "hemisphere"),
        ("GGA", "59.9,M", "59.9,F", "unit"),
        ("GGA", "59.9,M", "59.9,", "unit"),
        ("GGA", "59.9,M", "1e5,M", "not-a-number"),
        ("GGA", "59.9,M", "999999,M", "range"),
        ("GGA", "59.9,M", f"{'9' * 330},M", "range"),
        ("GGA", "E,1,", "E,-1,", "not-a-number"),
        ("GGA", "E,1,", "E,10,", "range"),
        ("GGA", ",08,", ",201,", "range"),
        ("GGA", "030719.000", "240000.000", "time"),
        ("GGA", "030719.000", "030760.000", "time"),
        ("GGA", "030719.000", "03071.000", "time"),
        ("GGA", "030719.000", "030719.", "time"),
        ("GGA", ",M,23.7,M,,0000", "", "fields"),
        ("RMC", "311214", "310214", "date"),
        ("RMC", "311214", "2208-1", "date"),
        ("RMC", ",A,3", ",X,3", "status"),
        ("RMC", ",,,A", ",,,x", "status"),
        ("RMC", "0.69", "-0.69", "range"),
        ("RMC", "0.69", "1e1", "not-a-number"),
        ("RMC", "181.39", "360.01", "range"),
        ("VTG", "0.004,N", "0.004,K", "unit"),
        ("VTG", "0.004,N", "inf,N", "not-a-number"),
        ("VTG", "77.52,T", "77.52,", "unit"),
        ("VTG", ",K,A", ",K,A,1", "fields"),
        ("GSA", "A,3,", "A,4,", "range"),
        ("GSA", ",1.5", "", "fields"),
        ("GLL", "195719", "19571", "time"),
        ("GNS", ",AN,", ",AX,", "status"),
        ("GNS", ",AN,", ",aN,", "status"),
        ("GNS", ",03,", ",A3,", "not-a-number"),
        ("GNS", ",W,", ",S,", "hemisphere"),
        ("GNS", "3844.24011", "9044.24011", "range"),
        ("GNS", ",10.5,,,,", ",10.5", "fields"),
        ("ZDA", "2014", "014", "date"),
        ("ZDA", "2014", "4", "date"),
        ("ZDA", "2014", "1979", "date"),
        ("ZDA", ",16,", ",00,", "date"),
        ("ZDA", "16,04", ",04", "date"),
        ("ZDA", "16,04", "31,04", "date"),
        ("HDG", "271.1", "371.1", "range"),
        ("HDG", "271.1", "-1.1", "range"),
        ("HDG", "10.7,E", "10.7,N", "hemisphere"),
        ("HDG", "10.7,E", "10.7,", "hemisphere"),
        ("HDG", "12.2,W", "-12.2,W", "hemisphere"),
        ("HDG", "12.2,W", "-181.0,E", "range"),
        ("HDG", ",12.2,W", "", "fields"),
    ],
)
def test_one_bad_field_refuses_the_sentence(formatter: str, old: str, new: str, reason: str) -> None:
    good = GOOD[formatter]
    assert old in good
    assert not isinstance(read(sealed(good)), str)
    assert read(sealed(good.replace(old, new, 1))) == reason


def test_gga() -> None:
    reading = read(GGA)
    assert isinstance(reading, Gga)
    assert isinstance(reading.position, Position)
    assert reading.position.lat_deg == pytest.approx(-(37 + 47.0873 / 60), abs=1e-12)
    assert reading.position.lon_deg == pytest.approx(175 + 18.8938 / 60, abs=1e-12)
    assert reading.position.step_m == pytest.approx(0.1852)
    assert (reading.tod_ms, reading.quality, reading.satellites) == (11_239_000, 1, 8)
    assert (reading.hdop, reading.alt_m) == (1.1, 59.9)


def test_rmc_and_gsa() -> None:
    reading = read(RMC)
    assert isinstance(reading, Rmc)
    assert (reading.sog_kn, reading.cog_true_deg, reading.date) == (0.69, 181.39, date(2014, 12, 31))
    assert (reading.status_valid, reading.mode) == (True, "A")
    gsa = read(GSA)
    assert gsa == Gsa(fix_mode=3, pdop=1.8, hdop=1.1, vdop=1.5)


@pytest.mark.parametrize(
    "data",
    [
        b"$GPRMC,,V,,,,,,,,,,N*53",
        b"$GPVTG,,,,,,,,,N*30",
        b"$GPGGA,,,,,,0,00,99.99,,,,,,*48",
        b"$GPGSA,A,1,,,,,,,,,,,,,,,*1E",
        b"$GPZDA,,,,,00,00*48",
        b"$GPGLL,,,,,,V,N*64",
    ],
)
def test_empty_fields_are_none_not_zero(data: bytes) -> None:
    reading = read(data)
    assert not isinstance(reading, str)
    for name in ("position", "sog_kn", "cog_true_deg", "date", "hdop", "pdop", "vdop", "alt_m", "tod_ms"):
        assert getattr(reading, name, None) is None


def test_a_cold_receiver_that_fills_the_place_in_is_void_not_refused() -> None:
    reading = read(b"$GPGGA,235946.005,8960.000000,N,00000.000000,E,0,0,,137.000,M,13.000,M,,*49")
    assert isinstance(reading, Gga)
    assert reading.position is None


@pytest.mark.parametrize(
    "body",
    [
        "GPRMC,071732.929,V,8960.0000,N,00000.0000,E,0.00,0.00,111111,,",
        "GPGLL,8960.0000,N,00000.0000,E,071732.929,V",
    ],
)
def test_the_filling_of_a_void_sentence_is_not_read(body: str) -> None:
    reading = read(sealed(body))
    assert isinstance(reading, Rmc | Gll)
    assert (reading.position, reading.status_valid, reading.tod_ms) == (None, False, 26_252_929)
    assert read(sealed(body.replace(",V", ",A"))) == "range"


def test_gns() -> None:
    reading = read(sealed("GNGNS,014035.00,4332.69262,S,17235.48549,E,RRNN,13,0.9,25.63,11.24,1.2,0000,V"))
    assert isinstance(reading, Gga)
    assert reading.position is not None
    assert reading.position.lat_deg == pytest.approx(-(43 + 32.69262 / 60), abs=1e-12)
    assert (reading.quality, reading.satellites, reading.hdop, reading.alt_m) == (4, 13, 0.9, 25.63)
    assert reading.tod_ms == 6_035_000


@pytest.mark.parametrize(
    ("letters", "quality"),
    [("A", 1), ("AN", 1), ("NNNN", 0), ("DAAN", 2), ("ADFR", 4), ("NF", 5), ("PA", 3), ("EN", 6), ("S", 8), ("", None)],
)
def test_gns_is_as_good_as_its_best_constellation(letters: str, quality: int | None) -> None:
    reading = read(sealed(f"GNGNS,014035.00,4332.69262,S,17235.48549,E,{letters},13,0.9,25.63,11.24,,"))
    assert isinstance(reading, Gga)
    assert reading.quality == quality
    assert (reading.position is None) == (not quality)


@pytest.mark.parametrize(
    ("data", "day"),
    [
        (sealed("GPZDA,120000,16,04,14,00,00"), date(2014, 4, 16)),
        (sealed("GPZDA,120000,16,04,79,00,00"), date(2079, 4, 16)),
        (sealed("GPZDA,120000,06,01,80,00,00"), date(1980, 1, 6)),
        (sealed("GPZDA,120000,06,01,1980,00,00"), date(1980, 1, 6)),
        (sealed("GPZDA,120000,00,00,0000,00,00"), None),
        (sealed("GPRMC,000231.42,A,4829.0005,N,00022.0016,E,0.16,212.28,220899,,,A"), date(1999, 8, 22)),
        (sealed("GPRMC,000231.42,A,4829.0005,N,00022.0016,E,0.16,212.28,220879,,,A"), date(2079, 8, 22)),
        (sealed("GPRMC,000000.00,V,,,,,,,000000,,,N"), None),
    ],
)
def test_years_of_two_digits_are_1980_to_2079(data: bytes, day: date | None) -> None:
    reading = read(data)
    assert isinstance(reading, Rmc | Zda)
    assert reading.date == day


@pytest.mark.parametrize(
    "body",
    [
        "GPGGA,120000,5012.7908,N,00806.8796,W,2,,,,,,,",
        "GPGGA,120000,5012.7908,N,00806.8796,W,2,04,1.0,5,M,,M,,",
        "GPGGA,120000.5,5012,N,00806,W,1,4,,,M,,M",
        "GNGGA,120000.123456,5012.790800,N,00806.879600,W,4,19,0.7,280.827,M,-31.442,M,6.0,0002,",
        "GPRMC,120000,A,5012.7908,N,00806.8796,W,000.0,094.5,060601",
        "GPRMC,120000,A,5012.7908,N,00806.8796,W,000.0,094.5,060601,024.1,E",
        "GPRMC,120000,A,5012.7908,N,00806.8796,W,0.5,3.0,010611,,A",
        "GNRMC,120000.00,A,5012.7908,N,00806.8796,W,0.5,,010611,,,R,V",
        "GPRMC,120000,D,5012.7908,N,00806.8796,W,0.5,,010611,,",
        "GPGLL,5012.7908,N,00806.8796,W,120000,A",
        "GNGLL,5012.7908,N,00806.8796,W,120000.00,A,D",
        "GNGNS,120000.00,5012.7908,N,00806.8796,W,AAAAAA,09,1.0,20.1,45.0,,",
        "GNGNS,120000.00,5012.7908,N,00806.8796,W,AANN,09,1.0,20.1,45.0,,,V",
    ],
)
def test_forms_of_nmea_2_0_to_4_11_have_their_position(body: str) -> None:
    reading = read(sealed(body))
    assert isinstance(reading, Gga | Rmc | Gll)
    assert reading.position is not None
    assert reading.tod_ms is not None
    assert reading.tod_ms // 1000 == 43_200


@pytest.mark.parametrize(
    "body",
    [
        "GPVTG,054.7,T,034.4,M,005.5,N,010.2,K",
        "GPVTG,054.7,T,034.4,M,005.5,N,010.2,K,A",
        "GPVTG,,T,,M,005.5,N,010.2,K,A",
        "GPGSA,A,3,,,,,,16,18,,22,24,,,3.6,2.1,2.2",
        "GNGSA,A,3,80,71,73,79,69,,,,,,,,1.83,1.09,1.47,2",
    ],
)
def test_untimed_forms(body: str) -> None:
    assert not isinstance(read(sealed(body)), str)


@pytest.mark.parametrize(
    ("text", "tod_ms"),
    [("235959.999", 86_399_999), ("235960", 86_400_000), ("000000.0009", 0), ("120000.5", 43_200_500)],
)
def test_time_of_day(text: str, tod_ms: int) -> None:
    reading = read(sealed(f"GPZDA,{text},31,12,2016,00,00"))
    assert reading == Zda(tod_ms=tod_ms, date=date(2016, 12, 31))


def test_unknown_dilutions_are_none() -> None:
    reading = read(sealed("GPGSA,A,1,,,,,,,,,,,,,99.99,99.9,0.0"))
    assert reading == Gsa(fix_mode=1, pdop=None, hdop=None, vdop=None)


def test_a_parser_that_breaks_is_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_text: str) -> object:
        raise IndexError

    monkeypatch.setattr("pynmea2.parse", broken)
    assert read(GGA) == "parser"


def test_formatter_without_a_row() -> None:
    assert read(sealed("GPXTE,,,,,N,N")) == "formatter"
