"""What the codec promises: equal round trips, old and new sides understand each other, faults are named."""

import dataclasses
import typing
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.codec import MAX_FRAME_BYTES, decode_frame, encode_frame
from common.errors import CodecError
from common.field_bounds import MaxLength, OneOf, Range
from common.messages import Event, Frame, Heading, RadarTarget, SensorHealth, TurnRate
from common.versions import SCHEMA_VERSION
from tests.strategies import (
    BLOCK,
    FIX,
    LIST_OF,
    MESSAGES,
    default,
    frame_of,
    frames,
    messages,
    required,
    sample,
    wire_key,
)


def raw(frame: Frame) -> dict[str, Any]:
    return dict(msgpack.unpackb(encode_frame(frame)))


def decode_map(fields: dict[str, Any]) -> Frame:
    return decode_frame(msgpack.packb(fields))


def fault_of(fields: Any) -> str:
    with pytest.raises(CodecError) as caught:
        decode_frame(msgpack.packb(fields))
    return str(caught.value)


# --- round trip ------------------------------------------------------------------------------------------------------


@given(frames)
def test_a_frame_comes_back_equal(frame: Frame) -> None:
    assert decode_frame(encode_frame(frame)) == frame


@pytest.mark.parametrize("cls", MESSAGES)
def test_every_message_type_comes_back_equal_with_its_types(cls: type) -> None:
    @given(messages(cls))
    def comes_back(message: Any) -> None:
        (back,) = getattr(decode_frame(encode_frame(frame_of(message))), LIST_OF[cls])
        assert back == message
        assert [type(getattr(back, f.name)) for f in dataclasses.fields(cls)] == [
            type(getattr(message, f.name)) for f in dataclasses.fields(cls)
        ]

    comes_back()


def test_times_travel_as_signed_microseconds_from_the_start_of_the_frame() -> None:
    health = SensorHealth(sensor="gps1", t_ns=1_000_002_000, state="silent", last_good_t_ns=400_000_000)
    wire = raw(frame_of(FIX, health))
    assert wire["fixes"][0]["dt_us"] == 0
    assert wire["health"][0]["dt_us"] == 2
    assert wire["health"][0]["last_good_dt_us"] == -600_000
    assert "t_ns" not in wire["fixes"][0]


def test_absent_and_default_fields_take_no_bytes_and_v_comes_first() -> None:
    wire = raw(frame_of(FIX))
    assert wire["fixes"][0] == {"sensor": "gps1", "dt_us": 0, "lat_deg": 50.0, "lon_deg": -4.0}
    health = SensorHealth(sensor="gps1", t_ns=1_000_000_000, state="missing", rejected={}, accepted=0)
    assert raw(frame_of(health))["health"] == [{"sensor": "gps1", "dt_us": 0, "state": "missing"}]
    assert next(iter(wire.items())) == ("v", SCHEMA_VERSION)
    assert set(wire) == {"v", "boat_id", "boot_id", "seq", "clock_id", "start_no", "t0_ns", "t1_ns", "fixes"}


def test_columns_are_little_endian_32_bit() -> None:
    block = raw(frame_of(BLOCK))["imu"][0]
    assert block["offset_us"] == bytes([0, 0, 0, 0, 0x50, 0xC3, 0, 0])
    assert block["accel_fwd_m_s2"] == bytes([0, 0, 0, 0x3F, 0, 0, 0x80, 0x3E])


# --- old and new sides -----------------------------------------------------------------------------------------------


@given(frames, st.sampled_from([1, "x", None, [1, [2]], {"deep": {"er": 1}}, b"\x00"]))
def test_unknown_fields_are_ignored_at_every_level(frame: Frame, unknown: Any) -> None:
    wire = raw(frame)
    wire["not_yet_invented"] = unknown
    for name in LIST_OF.values():
        for entry in wire.get(name, []):
            entry["not_yet_invented"] = unknown
    assert decode_map(wire) == frame


@given(frames, st.data())
def test_an_older_writer_leaves_out_any_optional_field(frame: Frame, data: st.DataObject) -> None:
    wire = raw(frame)
    optional = [f for f in dataclasses.fields(Frame) if not required(f) and f.name in wire]
    dropped = data.draw(st.sets(st.sampled_from([f.name for f in optional]))) if optional else set()
    for name in dropped:
        del wire[name]
    expected = {f.name: default(f) for f in optional if f.name in dropped}
    assert decode_map(wire) == dataclasses.replace(frame, **expected)


@pytest.mark.parametrize("cls", MESSAGES)
def test_an_older_writer_of_one_message(cls: type) -> None:
    @given(messages(cls))
    def only_required(message: Any) -> None:
        wire = raw(frame_of(message))
        keys = {wire_key(f.name): f for f in dataclasses.fields(cls)}
        (entry,) = wire[LIST_OF[cls]]
        wire[LIST_OF[cls]] = [{key: value for key, value in entry.items() if required(keys[key])}]
        (back,) = getattr(decode_map(wire), LIST_OF[cls])
        bare = {f.name: default(f) for f in dataclasses.fields(cls) if not required(f)}
        assert back == dataclasses.replace(message, **bare)

    only_required()


def test_an_explicit_null_means_absent() -> None:
    wire = raw(frame_of(FIX))
    wire["fixes"][0]["alt_m"] = None
    wire["utc_ns"] = None
    assert decode_map(wire) == frame_of(FIX)


def test_a_newer_schema_is_refused_with_a_sentence() -> None:
    assert "schema 2 is newer than this side's 1, install the same version" in fault_of({**raw(frame_of()), "v": 2})


@pytest.mark.parametrize(
    ("v", "text"), [(0, "v: must be >= 1"), ("1", "v: must be a whole number"), (True, "v: must be")]
)
def test_a_wrong_version_is_refused(v: Any, text: str) -> None:
    assert text in fault_of({**raw(frame_of()), "v": v})


# --- faults are named ------------------------------------------------------------------------------------------------


REQUIRED = [(cls, f.name) for cls in MESSAGES for f in dataclasses.fields(cls) if required(f)]


@pytest.mark.parametrize(("cls", "name"), REQUIRED)
def test_a_missing_required_field_is_named(cls: type, name: str) -> None:
    wire = raw(frame_of(sample(cls), sample(cls)))
    del wire[LIST_OF[cls]][1][wire_key(name)]
    assert fault_of(wire) == f"{LIST_OF[cls]}[1].{wire_key(name)}: missing"


@pytest.mark.parametrize("key", ["v", *(f.name for f in dataclasses.fields(Frame) if required(f))])
def test_a_missing_field_of_the_frame_is_named(key: str) -> None:
    wire = raw(frame_of())
    del wire[key]
    assert fault_of(wire) == f"{key}: missing"


def bounded() -> list[tuple[type, str, Any]]:
    """(class, field, value just outside) for every Range, OneOf and MaxLength of the messages."""
    cases: list[tuple[type, str, Any]] = []
    for cls in (*MESSAGES, Frame):
        for name, hint in typing.get_type_hints(cls, include_extras=True).items():
            arms = [hint, *typing.get_args(hint)]
            bounds = next((arm.__metadata__ for arm in arms if hasattr(arm, "__metadata__")), ())
            for bound in bounds:
                if isinstance(bound, Range):
                    if bound.low is not None:
                        cases.append((cls, name, bound.low - 1))
                    if bound.high is not None:
                        cases.append((cls, name, bound.high + 1))
                elif isinstance(bound, OneOf):
                    cases.append((cls, name, "no such choice"))
                elif isinstance(bound, MaxLength):
                    cases.append((cls, name, "x" * (bound.count + 1)))
    return cases


@pytest.mark.parametrize(("cls", "name", "value"), bounded())
def test_a_value_just_out_of_bounds_is_refused_on_both_sides(cls: type, name: str, value: Any) -> None:
    if cls is Frame:
        broken, path, wire = frame_of(**{name: value}), name, raw(frame_of())
        wire[name] = value
    else:
        broken = frame_of(dataclasses.replace(sample(cls), **{name: value}))
        path, wire = f"{LIST_OF[cls]}[0].{name}", raw(frame_of(sample(cls)))
        wire[LIST_OF[cls]][0][name] = value
    with pytest.raises(CodecError) as caught:
        encode_frame(broken)
    assert str(caught.value).startswith(f"{path}: must ")
    if not isinstance(value, int) or value < 2**64:
        assert fault_of(wire).startswith(f"{path}: must ")


def test_there_are_bounds_to_test() -> None:
    assert len(bounded()) > 80


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"lat_deg": float("nan")}, "fixes[0].lat_deg: must be finite, got nan"),
        ({"alt_m": float("inf")}, "fixes[0].alt_m: must be finite, got inf"),
        ({"lat_deg": 91.0}, "fixes[0].lat_deg: must be <= 90, got 91"),
        ({"lat_deg": "50"}, "fixes[0].lat_deg: must be a finite number, got '50'"),
        ({"lat_deg": True}, "fixes[0].lat_deg: must be a finite number, got True"),
        ({"satellites": True}, "fixes[0].satellites: must be a whole number, got True"),
        ({"satellites": 7.0}, "fixes[0].satellites: must be a whole number, got 7.0"),
        ({"held": 1}, "fixes[0].held: must be true or false, got 1"),
        ({"held": None}, "fixes[0].held: must be true or false, got None"),
        ({"sensor": b"gps1"}, "fixes[0].sensor: must be a text, got b'gps1'"),
        ({"sensor": None}, "fixes[0].sensor: must be a text, got None"),
    ],
)
def test_a_wrong_value_is_named_on_both_sides(change: dict[str, Any], text: str) -> None:
    wire = raw(frame_of(FIX))
    wire["fixes"][0].update(change)
    assert fault_of(wire) == text
    with pytest.raises(CodecError) as caught:
        encode_frame(frame_of(dataclasses.replace(FIX, **change)))
    assert str(caught.value) == text


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"fixes": {}}, "fixes: must be a list, got {}"),
        ({"fixes": [1]}, "fixes[0]: must be a map, got 1"),
        ({"fixes": [None]}, "fixes[0]: must be a map, got None"),
        ({"t0_ns": 1_000_000_001}, "t0_ns: must be whole microseconds, got 1000000001 ns"),
        ({"t0_ns": 1.0}, "t0_ns: must be a whole number, got 1.0"),
        ({"t0_ns": -(2**63)}, "t0_ns: must be whole microseconds, got -9223372036854775808 ns"),
        ({"headings": [{"sensor": "c", "dt_us": 2**62}]}, "headings[0].dt_us: must fit in 64 bits"),
        ({"events": [{"evidence": {"a": [1]}}]}, "events[0].evidence['a']: must be a text, a number"),
        ({"health": [{"rejected": {"crc": 1.5}}]}, "health[0].rejected['crc']: must be a whole number, got 1.5"),
        ({"health": [{"rejected": {b"crc": 1}}]}, "health[0].rejected[b'crc']: must be a text"),
    ],
)
def test_a_wrong_shape_on_the_wire_is_named(change: dict[str, Any], text: str) -> None:
    assert fault_of({**raw(frame_of()), **change}).startswith(text)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"yaw_rate_deg_s": bytes(4)}, "must be of equal length"),
        ({"yaw_rate_deg_s": bytes(7)}, "yaw_rate_deg_s: must be whole 32-bit samples, got 7 bytes"),
        ({"yaw_rate_deg_s": [1.0, 2.0]}, "yaw_rate_deg_s: must be a column"),
        ({"yaw_rate_deg_s": b"\x00\x00\x80\x7f" * 2}, "yaw_rate_deg_s: every sample must be finite"),
    ],
)
def test_a_broken_column_is_named(change: dict[str, Any], text: str) -> None:
    wire = raw(frame_of(BLOCK))
    wire["imu"][0].update(change)
    fault = fault_of(wire)
    assert fault.startswith("imu[0]")
    assert text in fault


@pytest.mark.parametrize(
    "broken",
    [
        frame_of(dataclasses.replace(FIX, t_ns=1_000_000_001)),
        frame_of(t0_ns=1),
        frame_of(dataclasses.replace(FIX, t_ns=2**70)),
        frame_of(dataclasses.replace(FIX, alt_m=10**400)),
        frame_of(dataclasses.replace(FIX, satellites=10**400)),
        frame_of(fixes=[FIX]),
        frame_of(fixes=(BLOCK,)),
        frame_of(fixes=(FIX,) * 9000),
        frame_of(dataclasses.replace(BLOCK, offset_us=(0, -1))),
        frame_of(dataclasses.replace(BLOCK, offset_us=(0,))),
        frame_of(dataclasses.replace(BLOCK, offset_us=(False, True))),
        frame_of(dataclasses.replace(BLOCK, yaw_rate_deg_s=(0.0, 1e39))),
        frame_of(dataclasses.replace(BLOCK, yaw_rate_deg_s=(0.0, float("nan")))),
        frame_of(dataclasses.replace(BLOCK, yaw_rate_deg_s=(0.0, "1"))),  # type: ignore[arg-type]
        frame_of(boat_id="\ud800"),
        frame_of(Event(t_ns=0, source="s", code="c", level="info", text="t", evidence={"a": object()})),  # type: ignore[dict-item]
        "no frame",
    ],
)
def test_the_encoder_refuses_what_the_decoder_would(broken: Any) -> None:
    with pytest.raises(CodecError):
        encode_frame(broken)


def test_a_whole_number_is_taken_for_a_float_and_becomes_one() -> None:
    (rate,) = decode_frame(encode_frame(frame_of(TurnRate(sensor="g", t_ns=0, rate_deg_s=3)))).turn_rates
    assert type(rate.rate_deg_s) is float
    assert rate.rate_deg_s == 3.0


def test_a_frame_over_the_limit_is_refused_on_both_sides() -> None:
    big = tuple(RadarTarget(sensor="r", t_ns=0, number=1, name="x" * 64, lat_deg=1.5, lon_deg=1.5) for _ in range(8192))
    with pytest.raises(CodecError, match="over the limit"):
        encode_frame(frame_of(*big, *(Heading(sensor="c", t_ns=0, heading_mag_deg=1.5) for _ in range(8192))))
    with pytest.raises(CodecError, match="over the limit"):
        decode_frame(bytes(MAX_FRAME_BYTES + 1))
