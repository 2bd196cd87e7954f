"""`wayfix export`: what it refuses, and that nothing is lost nor half written."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from common.errors import WayfixError
from tests.station.exporting import KINDS, empty_frame, export, log_of


def test_an_empty_log_gives_no_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = log_of(tmp_path / "empty.mcap", [])
    (tmp_path / "out").mkdir()
    for kind in KINDS:
        assert export(log, "--to", kind, tmp_path / "out" / f"x.{kind}", "--json") == 1
        said = capsys.readouterr()
        assert "holds no usable fix; nothing was written" in said.err
        assert json.loads(said.out.splitlines()[-1])["rows"] == 0
    assert list((tmp_path / "out").iterdir()) == []


def test_frames_without_a_fix_give_no_file(tmp_path: Path) -> None:
    log = log_of(tmp_path / "x.mcap", [empty_frame(1.0), empty_frame(1.1)])
    assert export(log, "--to", "csv", tmp_path / "x.csv") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["x.mcap"]


def test_what_is_read_is_never_lost(trip: Path, tmp_path: Path) -> None:
    log = tmp_path / "trip.mcap"
    log.write_bytes(trip.read_bytes())
    (tmp_path / "link.mcap").symlink_to(log)
    before = log.read_bytes()
    for target in (log, tmp_path / "link.mcap"):
        with pytest.raises(WayfixError, match="it would be lost"):
            export(log, "--to", "mcap", target, "--force")
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(before)
    with pytest.raises(WayfixError, match=r"is no mcap file of `wayfix export`"):
        export(log, "--to", "mcap", copy, "--force")
    assert log.read_bytes() == copy.read_bytes() == before


@pytest.mark.parametrize(
    ("kind", "ours", "theirs"),
    [
        ("gpx", b'creator="wayfix"', b'creator="Garmin"'),
        ("kml", b"<!-- of wayfix export -->", b""),
        ("geojson", b'"generator": "wayfix", ', b""),
        ("png", b"wayfix", b"others"),
    ],
)
def test_force_leaves_foreign_files_of_the_kind_alone(
    kind: str, ours: bytes, theirs: bytes, trip: Path, tmp_path: Path
) -> None:
    target = tmp_path / f"other.{kind}"
    assert export(trip, "--to", kind, target) == 0
    foreign = target.read_bytes().replace(ours, theirs, 1)
    target.write_bytes(foreign)
    with pytest.raises(WayfixError, match=r"is no .* file of `wayfix export`"):
        export(trip, "--to", kind, target, "--force")
    assert target.read_bytes() == foreign


@pytest.mark.parametrize("kind", KINDS)
def test_only_force_replaces_and_only_its_own_kind(kind: str, trip: Path, out: Path, tmp_path: Path) -> None:
    target = tmp_path / f"a.{kind}"
    target.write_bytes((out / f"trip.{kind}").read_bytes()[:1000])
    with pytest.raises(WayfixError, match=r"exists already; .*--force"):
        export(trip, "--to", kind, target)
    assert export(trip, "--to", kind, target, "--force") == 0
    assert target.stat().st_size > 1000
    target.write_bytes(b"my diary")
    with pytest.raises(WayfixError, match=f"exists already and is no {kind} file"):
        export(trip, "--to", kind, target, "--force")
    assert target.read_bytes() == b"my diary"


@pytest.mark.parametrize("kind", KINDS)
def test_a_full_disk_is_one_sentence_and_no_half_file(
    kind: str, trip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every write of every format fails at some byte; what was there before stays."""

    class Full:
        def __init__(self, stream: Any) -> None:
            self._stream = stream
            self._left = 2000

        def write(self, data: bytes) -> int:
            self._left -= len(data)
            if self._left < 0:
                raise OSError(28, "No space left on device")
            return int(self._stream.write(data))

        def __getattr__(self, name: str) -> Any:
            return getattr(self._stream, name)

    opened = Path.open

    def full(path: Path, mode: str = "r", *args: Any, **named: Any) -> Any:
        stream = opened(path, mode, *args, **named)
        return _Context(stream, Full(stream)) if mode == "xb" else stream

    class _Context:
        def __init__(self, stream: Any, shown: Any) -> None:
            self._stream, self._shown = stream, shown

        def __enter__(self) -> Any:
            return self._shown

        def __exit__(self, *_: object) -> None:
            self._stream.close()

    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(WayfixError, match=r"cannot be written \(No space left"):
        export(trip, "--to", kind, tmp_path / f"a.{kind}")
    assert list(tmp_path.iterdir()) == []


def test_targets_that_cannot_be(trip: Path, tmp_path: Path) -> None:
    with pytest.raises(WayfixError, match="no such directory"):
        export(trip, "--to", "gpx", tmp_path / "no" / "a.gpx")
    with pytest.raises(WayfixError, match="no plain file"):
        export(trip, "--to", "gpx", tmp_path)
    with pytest.raises(WayfixError, match="no such directory above it"):
        export(trip, "--to", "csv", f"{tmp_path}/no/such/")
    with pytest.raises(WayfixError, match="no plain file"):
        export(trip, "--to", "csv", "/dev/full")


def test_unknown_filters(trip: Path, tmp_path: Path) -> None:
    with pytest.raises(WayfixError, match="unknown filter 'kalman'"):
        export(trip, "--to", "csv", tmp_path / "a.csv", "--filter", "kalman")
    with pytest.raises(WayfixError, match=r"no estimates of kf .*which has fuzzy, ukf; add --order time"):
        export(trip, "--to", "csv", tmp_path / "a.csv", "--filter", "kf")


@pytest.mark.parametrize(
    ("kind", "package", "extra"), [("parquet", "polars", "analysis"), ("png", "matplotlib", "report")]
)
def test_a_missing_package_is_named_before_the_work(
    kind: str, package: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(WayfixError, match=rf"{package} is missing.*pip install '\.\[{extra}\]'"):
        export(tmp_path / "not read.mcap", "--to", kind, tmp_path / "a")


def test_the_others_need_no_extra(trip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("polars", "matplotlib"):
        monkeypatch.setitem(sys.modules, package, None)
    for kind in set(KINDS) - {"parquet", "png"}:
        assert export(trip, "--to", kind, tmp_path / f"a.{kind}") == 0


def test_a_directory_is_all_or_nothing(trip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    empty = log_of(tmp_path / "empty.mcap", [])
    assert export(empty, "--to", "csv", f"{tmp_path}/new/") == 1
    assert not (tmp_path / "new").exists()
    (tmp_path / "mine").mkdir()
    assert export(empty, "--to", "csv", tmp_path / "mine") == 1
    assert (tmp_path / "mine").is_dir()
    assert export(trip, "--to", "csv", tmp_path / "mine") == 0
    before = (tmp_path / "mine" / "imu.csv").read_bytes()
    with pytest.raises(WayfixError, match=r"estimates.csv: exists already"):
        export(trip, "--to", "csv", tmp_path / "mine")
    (tmp_path / "mine" / "imu.csv").write_text("my own notes")
    with pytest.raises(WayfixError, match=r"imu.csv: exists already and is no csv file"):
        export(trip, "--to", "csv", tmp_path / "mine", "--force")
    (tmp_path / "mine" / "imu.csv").unlink()
    monkeypatch.setattr("shore.exports.table._measured", _fail)
    with pytest.raises(WayfixError, match="cannot be written"):
        export(trip, "--to", "csv", tmp_path / "mine", "--force")
    assert not (tmp_path / "mine" / "imu.csv").exists()
    monkeypatch.undo()
    assert export(trip, "--to", "csv", tmp_path / "mine", "--force") == 0
    assert (tmp_path / "mine" / "imu.csv").read_bytes() == before
    assert {path.name[0] for path in (tmp_path / "mine").iterdir()} == set("efhi")


def _fail(*_: object) -> None:
    raise OSError(28, "No space left on device")
