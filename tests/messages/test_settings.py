"""Settings: every fault of a file at once, each with file, key and cure; and back to plain dicts."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import pytest

from common.boat_config import BoatConfig
from common.errors import SettingsError
from common.field_bounds import MaxLength, NeededFor, OneOf, OnlyFor, Range
from common.settings import as_dict, convert, read_toml

GOOD: dict[str, Any] = {
    "boat": {"id": "springer"},
    "port": [{"name": "plotter", "path": "/dev/ttyUSB0", "baud": 38400}],
    "sensor": [
        {"id": "gps1", "port": "plotter", "role": "gps", "rate_hz": 1, "talkers": ["GP"]},
        {"id": "imu1", "port": "plotter", "role": "imu", "use": ["yaw_rate"]},
    ],
}


def faults(data: Any, table: type = BoatConfig) -> list[str]:
    with pytest.raises(SettingsError) as caught:
        convert(data, table, "boat.toml")
    assert all(line.startswith("boat.toml: ") for line in str(caught.value).splitlines())
    return caught.value.faults


def test_a_good_file_becomes_frozen_tables(tmp_path: Path) -> None:
    path = tmp_path / "boat.toml"
    path.write_text('[boat]\nid = "springer"\n[[port]]\nname = "p"\npath = "/dev/x"\n[frames]\nrate_hz = 5\n')
    config = read_toml(path, BoatConfig)
    assert config.boat.id == "springer"
    assert config.port[0].baud == 4800
    assert type(config.frames.rate_hz) is float


def test_there_and_back_is_equal() -> None:
    config = convert(GOOD, BoatConfig)
    assert convert(as_dict(config), BoatConfig) == config
    assert "variation_deg" not in as_dict(config)["boat"]


def test_an_unknown_key_gets_a_hint() -> None:
    assert faults({**GOOD, "senser": []}) == ["senser: unknown key, did you mean sensor?"]
    assert faults({**GOOD, "boat": {"id": "b", "colour": "red"}}) == [
        "boat.colour: unknown key (known: id, variation_deg, current_sigma_m_s, leeway_m_s)"
    ]


def test_all_faults_are_told_at_once_each_with_its_entry() -> None:
    data = {
        "boat": {"id": 5},
        "port": [{"name": "a", "path": "/dev/a", "baud": 1}, {"nam": "b", "path": "/dev/b"}],
        "sensor": [
            {"id": "gps1", "port": "a", "role": "gpz"},
            {"id": "imu1", "port": "a", "role": "imu", "rate_hz": -1, "use": ["up"]},
            {"port": "a", "role": "imu"},
            "text",
        ],
        "frames": {"rate_hz": "fast"},
    }
    told = faults(data)
    assert told == [
        "boat.id: must be a text, got 5",
        "frames.rate_hz: must be a number, got 'fast'",
        "[[port]] a.baud: must be >= 300, got 1",
        "[[port]] 2.nam: unknown key, did you mean name?",
        "[[port]] 2.name: missing",
        "[[sensor]] gps1.role: must be one of gps, imu, gyro, compass, ais, radar, got 'gpz'",
        "[[sensor]] imu1.rate_hz: must be >= 0.01, got -1",
        "[[sensor]] imu1.use[1]: must be one of accel_fwd, accel_stb, yaw_rate, got 'up'",
        "[[sensor]] 3.id: missing",
        "sensor[4]: must be a table",
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Inner:
    length: Annotated[float, Range(0.0, 10.0)]
    on: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class _Outer:
    inner: _Inner
    count: Annotated[int, Range(1, 3)] = 1
    mode: Annotated[str, OneOf(("a", "b"))] | None = None
    name: Annotated[str, MaxLength(3)] = ""
    more: tuple[_Inner, ...] = field(default=())


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"inner": 1}, "inner: must be a table"),
        ({"inner": {}}, "inner.length: missing"),
        ({"inner": {"length": 11}}, "inner.length: must be <= 10, got 11"),
        ({"inner": {"length": True}}, "inner.length: must be a number, got True"),
        ({"inner": {"length": float("nan")}}, "inner.length: must be finite, got nan"),
        ({"inner": {"length": float("inf")}}, "inner.length: must be finite, got inf"),
        ({"inner": {"length": 1, "on": 1}}, "inner.on: must be true or false, got 1"),
        ({"count": 1.0}, "count: must be a whole number, got 1.0"),
        ({"count": True}, "count: must be a whole number, got True"),
        ({"count": 4}, "count: must be <= 3, got 4"),
        ({"mode": "c"}, "mode: must be one of a, b, got 'c'"),
        ({"name": "abcd"}, "name: must be at most 3 characters, got 4"),
        ({"name": "a\0"}, "name: has a character that cannot be shown: 'a\\x00'"),
        ({"name": "\u202eb"}, "name: has a character that cannot be shown: '\\u202eb'"),
        ({"name": "\x1b["}, "name: has a character that cannot be shown: '\\x1b['"),
        ({"more": {"length": 1}}, "more: must be a list, got {'length': 1}"),
        ({"more": [{"length": 1}, {"length": -1}]}, "[[more]] 2.length: must be >= 0, got -1"),
    ],
)
def test_a_fault_names_its_key(change: dict[str, Any], fault: str) -> None:
    assert faults({"inner": {"length": 1}, **change}, _Outer) == [fault]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shared:
    """A file that a reader and a writer read."""

    path: str
    lines: Annotated[int, OnlyFor("reader"), Range(1, 9)] = 1
    size: Annotated[float | None, NeededFor("writer")] = None


@pytest.mark.parametrize(
    ("use", "change", "fault"),
    [
        ("reader", {"lines": 10}, "lines: must be <= 9, got 10"),
        ("writer", {"lines": 1, "size": 1}, "lines: unknown key (known: path, size)"),
        (None, {"lines": 1}, "lines: unknown key (known: path, size)"),
        ("writer", {}, "size: missing"),
    ],
)
def test_each_use_of_a_file_knows_and_needs_its_own_keys(use: str | None, change: dict[str, Any], fault: str) -> None:
    with pytest.raises(SettingsError) as caught:
        convert({"path": "a", **change}, _Shared, use=use)
    assert caught.value.faults == [fault]
    assert convert({"path": "a", "lines": 3}, _Shared, use="reader") == _Shared(path="a", lines=3)
    assert convert({"path": "a", "size": 3}, _Shared, use="writer") == _Shared(path="a", size=3.0)


def test_a_whole_number_is_taken_for_a_float() -> None:
    made = convert({"inner": {"length": 3}}, _Outer)
    assert type(made.inner.length) is float


@pytest.mark.parametrize(
    ("text", "words"),
    [(None, "cannot be read"), ("[boat", "is not valid TOML"), (b"\xff\xfe", "is not valid TOML")],
)
def test_an_unreadable_file_is_told_with_its_name(tmp_path: Path, text: str | bytes | None, words: str) -> None:
    path = tmp_path / "boat.toml"
    if isinstance(text, str):
        path.write_text(text)
    elif text is not None:
        path.write_bytes(text)
    with pytest.raises(SettingsError, match=words) as caught:
        read_toml(path, BoatConfig)
    assert str(path) in str(caught.value)


def test_keys_of_a_newer_board_are_passed_over_when_not_strict() -> None:
    wire = {
        "boat": {"id": "b", "hull": 2},
        "sensor": [{"id": "gps1", "port": "p", "role": "gps", "lever": 1}],
        "new": 1,
    }
    config = convert(wire, BoatConfig, strict=False)
    assert (config.boat.id, config.sensor[0].id) == ("b", "gps1")
    with pytest.raises(SettingsError):
        convert(wire, BoatConfig)
