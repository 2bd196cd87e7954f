"""What the station keeps of boats, and of itself."""

import argparse
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import WayfixError
from common.keys import key_text
from shore.link.choose_boat import meet
from shore.link.known_boats import Boat, Boats, directory_of

A, B = (key_text(bytes([number]) * 32).encode() for number in (1, 2))


def test_where_keys_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/somebody")
    assert directory_of(None, {}) == Path("/somebody/.config/wayfix")
    assert directory_of(None, {"XDG_CONFIG_HOME": "/c"}) == Path("/c/wayfix")
    assert directory_of(None, {"XDG_CONFIG_HOME": "relative"}) == Path("/somebody/.config/wayfix")
    assert directory_of(None, {"XDG_CONFIG_HOME": "/c", "WAYFIX_KEYS": "/k"}) == Path("/k")
    assert directory_of(Path("/d"), {"WAYFIX_KEYS": "/k"}) == Path("/d")


def test_a_new_station_has_a_key_and_no_boat(tmp_path: Path) -> None:
    boats = Boats(tmp_path / "new" / "wayfix")
    assert boats.all() == []
    assert not boats.directory.exists()  # looking makes nothing
    key = boats.public_key
    assert Boats(boats.directory).public_key == key
    assert len(boats.secret_key) == 40
    assert boats.directory.stat().st_mode & 0o777 == 0o700
    assert (boats.directory / "secret-key").stat().st_mode & 0o777 == 0o600


def test_boats_are_remembered(tmp_path: Path) -> None:
    boats = Boats(tmp_path)
    boats.remember("springer", A, "10.0.0.1:5760")
    boats.remember("my other boat", B)
    assert Boats(tmp_path).all() == [Boat("springer", A, "10.0.0.1:5760"), Boat("my other boat", B, None)]
    written_ns = boats.file.stat().st_mtime_ns
    boats.remember("springer", A, "10.0.0.1:5760")
    assert boats.file.stat().st_mtime_ns == written_ns
    boats.remember("springer", A, "[fe80::1%wlan0]:5760")
    assert {boat.address for boat in boats.all()} == {"[fe80::1%wlan0]:5760", None}
    assert boats.file.stat().st_mode & 0o777 == 0o600
    assert boats.forget("springer") is True
    assert boats.forget("springer") is False
    assert [boat.boat_id for boat in boats.all()] == ["my other boat"]


def test_a_boat_that_is_paired_again_has_its_new_key_only(tmp_path: Path) -> None:
    boats = Boats(tmp_path)
    boats.remember("springer", A, "a")
    boats.remember("springer", B, "b")
    assert boats.all() == [Boat("springer", B, "b")]
    boats.remember("renamed", B, "b")
    assert boats.all() == [Boat("renamed", B, "b")]


@pytest.mark.parametrize(("boat_id", "key", "address"), [
    ("", A, "a"), ("a\nb", A, "a"), ("x" * 65, A, "a"), ("b", A[1:], "a"), ("b", b"\xff" * 40, "a"),
    ("b", A, "a b"), ("b", A, "a\n"), ("b", A, "x" * 129), ("b", A, "\xe4"),
])  # fmt: skip
def test_what_cannot_be_kept_is_refused(tmp_path: Path, boat_id: str, key: bytes, address: str) -> None:
    boats = Boats(tmp_path)
    with pytest.raises(WayfixError):
        boats.remember(boat_id, key, address)
    assert boats.all() == []


def test_damaged_lines_are_named_and_kept(tmp_path: Path) -> None:
    boats = Boats(tmp_path)
    boats.remember("springer", A, "a")
    with boats.file.open("a", encoding="utf-8") as file:
        file.write(f"junk\n{B.decode()} - twice\n{B.decode()} - twice\n")
    assert [boat.boat_id for boat in boats.all()] == ["springer"]
    assert boats.faults() == ["line 3 is not KEY WORD NAME: skipped", "twice or its key stands there twice: skipped"]
    boats.remember("springer", A, "b")
    assert "junk" in boats.file.read_text(encoding="utf-8")
    boats.file.chmod(0o666)
    with pytest.raises(WayfixError, match="others have rights"):
        boats.all()
    with pytest.raises(WayfixError, match="others have rights"):
        boats.remember("springer", B)


def test_an_id_with_two_keys_is_nobodys(tmp_path: Path) -> None:
    boats = Boats(tmp_path)
    boats.remember("springer", A, "a")
    with boats.file.open("a", encoding="utf-8") as file:
        file.write(f"{B.decode()} b springer\n")
    assert boats.all() == []


def test_a_full_disk_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("shore.link.known_boats.write_own", full)
    with pytest.raises(WayfixError, match="No space left"):
        Boats(tmp_path).remember("springer", A)


@given(data=st.binary(max_size=300))
def test_any_file_is_read(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    boats = Boats(tmp_path_factory.mktemp("boats"))
    boats.file.write_bytes(data)
    boats.file.chmod(0o600)
    assert boats.all() == []
    boats.remember("springer", A)
    assert [boat.boat_id for boat in boats.all()] == ["springer"]


def test_an_own_key_that_cannot_be_used_is_told_before_anybody_is_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    boats = Boats(tmp_path)
    boats.remember("springer", A, "a")
    assert boats.public_key
    (tmp_path / "secret-key").chmod(0o644)
    monkeypatch.setattr("shore.link.discovery.find", lambda *_: pytest.fail("it looks"))
    given = argparse.Namespace(address=None, boat=None, open=False)
    with pytest.raises(WayfixError, match="others have rights"):
        meet(given, Boats(tmp_path))
