"""The readers of foreign recordings: known values come out as they went in."""

import json
import math
from pathlib import Path

import pytest

from common.errors import WayfixError
from common.units import M_S_PER_KN, NS_PER_S
from shore.imports.reader import Lines
from shore.imports.signalk import SELF, own_contexts
from tests.station.imports import MAP, T0, Importer, delta, sealed, tpv


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Importer:
    return Importer(tmp_path, capsys)


def test_signal_k_values_in_our_units(importer: Importer) -> None:
    lines = [
        delta(0, "gps.GP", position={"latitude": 60.1, "longitude": -24.5, "altitude": 3.0}),
        delta(0, "gps.GP", speedOverGround=3.0, courseOverGroundTrue=math.pi / 2),
        delta(0.1, "compass.HC", headingMagnetic=math.pi, magneticVariation=-0.1),
        delta(0.2, "compass.HC", rateOfTurn=-math.radians(2.0)),
        delta(0.3, "compass.HC", attitude={"roll": math.radians(5), "pitch": math.radians(-3), "yaw": None}),
        delta(0.4, "gyro.TI", rateOfTurn=math.radians(1.0)),
        delta(0.5, "gnss.HE", headingTrue=math.radians(359.0)),
        delta(1, "gps.GP", position={"latitude": 60.2, "longitude": -24.6}),
    ]
    imported = importer.text("\n".join(lines))
    assert imported.summary["kind"] == "Signal K deltas"
    assert imported.summary["utc"] == "2023-11-14T22:13:20+00:00"
    first, second = imported.fixes
    assert (first.sensor, first.t_ns, first.utc_ns) == ("gps1", T0, T0)
    assert (first.lat_deg, first.lon_deg, first.alt_m) == (60.1, -24.5, 3.0)
    assert first.sog_kn == pytest.approx(3.0 / M_S_PER_KN)
    assert first.cog_true_deg == pytest.approx(90.0)
    assert (second.lat_deg, second.sog_kn, second.t_ns) == (60.2, None, T0 + NS_PER_S)
    magnetic, true = imported.headings
    assert (magnetic.sensor, magnetic.heading_true_deg, magnetic.heading_mag_deg) == ("compass1", None, 180.0)
    assert magnetic.variation_deg == pytest.approx(math.degrees(-0.1))
    assert (true.sensor, true.heading_mag_deg) == ("compass2", None)
    assert true.heading_true_deg == pytest.approx(359.0)
    assert [(rate.sensor, round(rate.rate_deg_s, 9)) for rate in imported.turn_rates] == [
        ("compass1", -2.0),
        ("gyro1", 1.0),
    ]
    (attitude,) = imported.attitudes
    assert attitude.sensor == "compass1"
    assert attitude.roll_deg == pytest.approx(5.0)
    assert attitude.pitch_deg == pytest.approx(-3.0)
    assert attitude.yaw_deg is None
    assert imported.account("values")["total"] == 10
    assert imported.session[0]["utc_ns"] == T0
    assert imported.session[-2]["import"]["sources"]["compass2"] == "gnss.HE"


def test_signal_k_of_other_vessels_and_of_the_server_itself_is_left_out(importer: Importer) -> None:
    place = {"latitude": 1.0, "longitude": 2.0}
    lines = [
        '{"name":"signalk-server","self":"vessels.urn:mrn:signalk:uuid:1","version":"2.0.0"}',
        delta(0, "ais", position=place).replace("vessels.self", "vessels.urn:mrn:imo:mmsi:230000000"),
        delta(0, "gps", position={"latitude": 3.0, "longitude": 4.0}).replace(SELF, "vessels.urn:mrn:signalk:uuid:1"),
        delta(0, "derived-data", headingTrue=1.0),
        delta(0, "gps", depth=3.0),
        "not json",
    ]
    imported = importer.text("\n".join(lines))
    assert [(fix.lat_deg, fix.lon_deg) for fix in imported.fixes] == [(3.0, 4.0)]
    assert imported.headings == []
    assert imported.account("values")["ignored"] == {
        "no delta": 1,
        "of another vessel": 1,
        "other path": 1,
        "worked out by the server": 1,
    }
    assert imported.account("values")["rejected"] == {"no JSON": 1}


def test_whose_deltas_are_ours(tmp_path: Path) -> None:
    def own(*lines: str, wanted: str | None = None) -> tuple[str, ...]:
        (tmp_path / "log").write_text("\n".join(lines))
        return own_contexts(Lines(tmp_path / "log"), wanted, "a.log")

    ours = delta(0, "a", headingTrue=1.0).replace(SELF, "vessels.urn:mrn:signalk:uuid:1")
    other = delta(0, "a", position={}).replace(SELF, "vessels.urn:mrn:imo:mmsi:2")
    third = other.replace("mmsi:2", "mmsi:12")
    greeting = '{"self":"urn:mrn:signalk:uuid:1"}'
    assert own(ours) == own(other, other, ours) == ("vessels.urn:mrn:signalk:uuid:1",)
    assert own(other, delta(0, "a", position={})) == own("{}") == (SELF,)
    assert own('{"updates":[{"meta":[]}]}', '{"context":5,"updates":[{"values":[1]}]}', other) == own(other)
    assert own(other, other.replace("vessels.", "atons.")) == ("vessels.urn:mrn:imo:mmsi:2",)
    assert own(other, third, greeting) == own(ours, greeting, wanted="self") == ("vessels.urn:mrn:signalk:uuid:1", SELF)
    for wanted in ("2", "urn:MRN:imo:mmsi:2", "vessels.urn:mrn:imo:mmsi:2"):
        assert own(ours, other, third, greeting, wanted=wanted) == ("vessels.urn:mrn:imo:mmsi:2",)
    with pytest.raises(WayfixError, match="2 vessels and does not say") as caught:
        own(ours, ours.replace("uuid:1", "uuid:2"))  # both steer
    assert "--vessel NAME: urn:mrn:signalk:uuid:1, urn:mrn:signalk:uuid:2" in str(caught.value)
    with pytest.raises(WayfixError, match="2 vessels and does not say"):
        own(other, third)  # neither does
    with pytest.raises(WayfixError, match="no vessel of the name '3'"):
        own(other, third, wanted="3")
    with pytest.raises(WayfixError, match="several vessels of the name '2'"):
        own(other, other.replace("imo", "foo"), wanted="2")


def test_only_the_vessel_that_was_asked_for(importer: Importer) -> None:
    lines = [
        delta(second, "gps", position={"latitude": 10.0 + mmsi, "longitude": 2.0}).replace(SELF, f"vessels.x:{mmsi}")
        for second in range(4)
        for mmsi in (1, 2)
    ]
    lines += [delta(second, "gps", position={"latitude": 50.0, "longitude": 2.0}) for second in range(4)]
    assert {fix.lat_deg for fix in importer.text("\n".join(lines)).fixes} == {50.0}
    imported = importer.text("\n".join(lines), "--vessel", "2", out="second.mcap")
    assert {fix.lat_deg for fix in imported.fixes} == {12.0}
    assert imported.summary["own"] == "vessels.x:2"
    assert imported.account("values")["ignored"] == {"of another vessel": 8}
    with pytest.raises(WayfixError, match="the boat's own sentences"):
        importer.text("1700000000000;N;$GPGLL,1,N,2,E*00\n", "--vessel", "2", out="third.mcap")


def test_values_that_cannot_be_are_refused_alone(importer: Importer) -> None:
    lines = [
        delta(0, "a", position={"latitude": 91.0, "longitude": 2.0}, speedOverGround=1.0),
        delta(1, "a", position={"latitude": 1.0, "longitude": 2.0}, speedOverGround=-1.0),
        delta(2, "a", position={"latitude": True, "longitude": 2.0}, headingTrue="north"),
        delta(3, "a", position={"latitude": 1.0}, rateOfTurn=1e400),
    ]
    imported = importer.text("\n".join(lines))
    assert [(fix.lat_deg, fix.sog_kn) for fix in imported.fixes] == [(None, pytest.approx(1 / M_S_PER_KN)), (1.0, None)]
    assert imported.account("values")["rejected"] == {
        "headingTrue headingTrue: no number": 1,
        "position half a position": 1,
        "position latitude: no number": 1,
        "position latitude: out of range": 1,
        "rateOfTurn rateOfTurn: out of range": 1,
        "speedOverGround speedOverGround: out of range": 1,
    }


RMC = (
    "$GPRMC,120000,A,6000.000,N,02400.000,E,5.0,090.0,141123,,,A*",
    "$GPRMC,120001,A,6000.001,N,02400.000,E,5.0,090.0,141123,,,A*",
)


def test_a_server_log_with_sentences_goes_through_the_boats_decoders(importer: Importer) -> None:
    lines = [f"{1_700_000_000_000 + 1000 * number};nmea;{sealed(text)}" for number, text in enumerate(RMC)]
    lines += ['1700000002000;I;{"updates":[]}', "1700000002000;A;2023-11-14,2,127250,204,255,8,ff", "rubbish"]
    imported = importer.text("\r\n".join(lines))
    assert imported.summary["kind"] == "Signal K server log"
    assert [(fix.lat_deg, fix.lon_deg) for fix in imported.fixes] == [
        (60.0, 24.0),
        (pytest.approx(60 + 1e-3 / 60), 24.0),
    ]
    account = imported.account("lines")
    assert account["total"] == 5
    assert account["taken"] == {"gps1 RMC": 2}
    assert account["ignored"] == {"NMEA 2000 or other": 1, "delta": 1}
    assert account["rejected"] == {"no line of a server's log": 1}


def test_a_server_log_tells_the_pace_of_sentences_without_times(importer: Importer) -> None:
    lines = [f"{1_700_000_000_000 + 100 * number};;{sealed(f'$HCHDM,{number:03d}.0,M*')}" for number in range(50)]
    imported = importer.text("\n".join(lines))
    assert len(imported.headings) == 50
    assert imported.summary["seconds"] == pytest.approx(4.9 + 2.0, abs=0.3)
    assert imported.summary["utc"] == "2023-11-14T22:13:20+00:00"


def test_a_server_log_tells_when_each_sentence_came(importer: Importer) -> None:
    lines = [f"{1_700_000_000_000 + at};;{sealed('$HCHDM,090.0,M*')}" for at in (0, 100, 5_000, 5_100)]
    imported = importer.text("\n".join(lines))
    first_ns = imported.headings[0].t_ns
    assert [heading.t_ns - first_ns for heading in imported.headings] == [
        at * 1_000_000 for at in (0, 100, 5_000, 5_100)
    ]


def test_a_server_log_of_deltas_has_one_clock_for_all_sources(importer: Importer) -> None:
    lines = [
        "1700000000000;I;" + delta(30, "a", position={"latitude": 1.0, "longitude": 2.0}),
        "1700000000500;I;" + delta(0, "b", headingTrue=1.0),
    ]
    imported = importer.text("\n".join(lines))
    assert [fix.t_ns for fix in imported.fixes] == [T0]
    assert [heading.t_ns for heading in imported.headings] == [T0 + NS_PER_S // 2]


def test_gpsd_values_in_our_units(importer: Importer) -> None:
    lines = [
        '{"class":"VERSION","release":"3.25"}',
        "$GPGGA,raw,sentence*00",
        tpv(0, lat=1.0, lon=2.0),
        tpv(0, lat=1.5, lon=2.5, speed=10.0, track=270.5, altMSL=7.0, status=3),
        '{"class":"ATT","heading":10.0,"pitch":1.0,"roll":-2.0,"rot":30.0}',
        '{"class":"IMU","acc_x":0.5,"acc_y":-0.25,"acc_z":9.8,"gyro_z":3.0}',
        tpv(1, mode=1),
        tpv(1.5, lat=95.0, lon=2.0),
        tpv(None, lat=1.0, lon=1.0),
    ]
    imported = importer.text("\n".join(lines))
    fix, void, late = imported.fixes
    assert (fix.lat_deg, fix.lon_deg, fix.alt_m, fix.fix_quality, fix.fix_mode) == (1.5, 2.5, 7.0, 4, 3)
    assert fix.sog_kn == pytest.approx(10 / M_S_PER_KN)
    assert (fix.cog_true_deg, fix.utc_ns) == (270.5, T0)
    assert (void.lat_deg, void.fix_mode, void.usable) == (None, 1, False)
    assert late.utc_ns is None
    (heading,) = imported.headings
    assert (heading.heading_true_deg, heading.pitch_deg, heading.roll_deg) == (10.0, 1.0, -2.0)
    assert T0 < heading.t_ns < T0 + NS_PER_S
    assert [rate.rate_deg_s for rate in imported.turn_rates] == [0.5]
    (block,) = [block for frame in imported.frames for block in frame.imu]
    assert (block.accel_fwd_m_s2, block.accel_stb_m_s2, block.yaw_rate_deg_s) == ((0.5,), (-0.25,), (3.0,))
    config = imported.session[0]["connected"]["config"]
    assert [sensor["use"] for sensor in config["sensor"] if sensor["role"] == "imu"] == [[]]
    account = imported.account("lines")
    assert account["taken"] == {"ATT": 1, "IMU": 1, "TPV": 3}
    assert account["ignored"] == {"TPV of the same epoch": 1, "VERSION": 1, "raw sentence": 1}
    assert account["rejected"] == {"TPV lat: out of range": 1}


def test_gpsd_repeats_old_angles_beside_new_ones(importer: Importer) -> None:
    att = [
        {"heading": 10.0},
        {"heading": 10.0, "rot": 6.0},
        {"heading": 11.0, "rot": 6.0},
        {"heading": 11.0, "rot": 6.0},
    ]
    imported = importer.text("\n".join(json.dumps({"class": "ATT", **one}) for one in att))
    assert [heading.heading_true_deg for heading in imported.headings] == [10.0, 11.0, 11.0]
    assert [rate.rate_deg_s for rate in imported.turn_rates] == [pytest.approx(0.1)] * 2


def test_a_decimal_comma_in_times_too(importer: Importer) -> None:
    mapping = importer.directory / "map.toml"
    mapping.write_text(MAP)
    table = "t;lat;lon;v;psi;r\n1700000000,5;60,5;24,1;1;2;3\n1700000001,5;60,5;24,1;1;2;3\n"
    imported = importer.text(table, "--map", str(mapping))
    assert [(fix.t_ns, fix.lat_deg) for fix in imported.fixes] == [
        (T0 + NS_PER_S // 2 + n * NS_PER_S, 60.5) for n in (0, 1)
    ]


def test_a_table_with_holes_and_rubbish(importer: Importer) -> None:
    mapping = importer.directory / "map.toml"
    mapping.write_text(MAP)
    rows = [
        "t;lat;lon;v;psi;r",
        "1700000000;60,5;24.5;1;100;1",
        "1700000000.5;;24.5;1;;nan",
        "1700000001;60.5;250;1;x;2",
        ";60;24;1;1;1",
        "soon;60;24;1;1;1",
        "1700000002;60;24;;-90;",
    ]
    imported = importer.text("\n".join(rows), "--map", str(mapping), name="in.csv")
    assert [(fix.lat_deg, fix.lon_deg, fix.sog_kn) for fix in imported.fixes] == [(60.5, 24.5, 2.0), (60.0, 24.0, None)]
    assert [heading.heading_true_deg for heading in imported.headings] == [350.0, 180.0]
    assert [(rate.sensor, rate.rate_deg_s) for rate in imported.turn_rates] == [("gyro1", -10.0), ("gyro1", -20.0)]
    assert imported.account("rows") == {
        "total": 6,
        "taken": {"with time": 4},
        "ignored": {},
        "rejected": {"time: empty": 1, "time: not a number": 1},
        "first": {
            "time: empty": "line 5, column 't', value ''",
            "time: not a number": "line 6, column 't', value 'soon'",
        },
    }
    assert imported.account("rows for fix")["rejected"] == {"lon: out of range": 1}
    assert imported.account("rows for fix")["ignored"] == {"empty": 1}
    assert imported.account("rows for heading")["rejected"] == {"not a number": 1}
