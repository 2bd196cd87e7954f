"""A recovered log holds every sound record, byte for byte, opens everywhere, and its source is untouched."""

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from common.errors import WayfixError
from shore.logbook.log_reader import read_log
from shore.logbook.log_writer import new_log
from shore.logbook.session import trip_record
from shore.trips.recover import name_log, recover
from tests.station.log_files import START, UTC_NS, Seen, chunks_of, log_bytes, other_writer, seen, write

TRIP = trip_record("sea trial", "Solent", None)


def quiet(*_: object) -> None:
    pass


def harmed_chunk(content: bytes, number: int = 3) -> bytes:
    broken = bytearray(content)
    at, end = chunks_of(content)[number]
    broken[(at + end) // 2] ^= 0xFF
    return bytes(broken)


def without(content: bytes, at: int, size: int) -> bytes:
    return content[:at] + content[at + size :]


HARMS: dict[str, Callable[[bytes], bytes]] = {
    "whole": lambda content: content,
    "damaged": harmed_chunk,
    "cut": lambda content: content[: len(content) // 2],
    "zeros": lambda content: content[: len(content) // 2] + bytes(3000),
    "cut and damaged": lambda content: harmed_chunk(content)[: len(content) // 2],
    "cut in the index": lambda content: content[:-100],
    "two logs": lambda content: content[: len(content) // 2] + other_writer(),
    "the same log twice": lambda content: content + content,
    "a hole at the beginning": lambda content: without(content, 100, 2500),
    "a damaged header": lambda content: content[:9] + b"\xff" * 12 + content[21:],
    "no chunks": lambda _: other_writer(use_chunking=False),
    "lz4": lambda _: other_writer(compression=CompressionType.LZ4),
}


@pytest.mark.parametrize("size", [8, 50, 300])
def test_a_log_of_which_nothing_is_sound_gives_no_new_one(tmp_path: Path, size: int) -> None:
    source = tmp_path / "trip.mcap"
    source.write_bytes(log_bytes(100)[:size])
    with pytest.raises(WayfixError, match="holds no sound record"):
        recover(source, None, None, quiet)
    assert list(tmp_path.iterdir()) == [source]


@pytest.mark.parametrize("harm", HARMS)
def test_what_is_sound_is_kept_byte_for_byte_with_an_index(tmp_path: Path, harm: str) -> None:
    source = tmp_path / "trip.mcap"
    source.write_bytes(HARMS[harm](log_bytes(100)))
    before = source.read_bytes()
    done = recover(source, None, None, quiet)
    assert done.path == tmp_path / "trip-recovered.mcap"
    assert source.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["trip-recovered.mcap", "trip.mcap"]
    was, now = seen(before), seen(done.path.read_bytes(), check_index=True)
    assert now.messages[:-1] == was.messages
    assert now.others == was.others or sorted(map(repr, now.others)) == sorted(map(repr, was.others))
    assert not now.losses
    assert not now.scan.flaws
    with done.path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = [message.data for _, _, message in reader.iter_messages(log_time_order=False)]
        summary = reader.get_summary()
    assert found == [message[4] for message in now.messages]
    assert summary is not None
    assert summary.chunk_indexes
    end = json.loads(now.messages[-1][4])
    assert (end["kind"], end["from"]) == ("recovered", "trip.mcap")
    assert [loss["first_byte"] for loss in end["losses"]] == [loss.first_byte for loss in was.losses]
    assert schemas_of(now) >= schemas_of(was) | {"wayfix.Session"}


def schemas_of(what: Seen) -> set[str]:
    return {schema.name for schema in what.scan.schemas.values()}


def test_recovering_a_hundred_random_cuts(tmp_path: Path) -> None:
    content = log_bytes(100)
    rng = random.Random(11)
    source, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    for _ in range(100):
        source.write_bytes(content[: rng.randrange(9, len(content))])
        sound = seen(source.read_bytes()).messages
        if sound:
            recover(source, out, None, quiet)
            assert seen(out.read_bytes()).messages[:-1] == sound
            out.unlink()
        else:
            with pytest.raises(WayfixError, match="holds no sound record"):
                recover(source, out, None, quiet)
            assert not out.exists()


def test_the_same_source_gives_the_same_bytes(tmp_path: Path) -> None:
    source = tmp_path / "cut.mcap"
    source.write_bytes(log_bytes(100)[:-2000])
    outs = [recover(source, tmp_path / name, TRIP, quiet).path.read_bytes() for name in ("a.mcap", "b.mcap")]
    assert outs[0] == outs[1]


def test_a_recovered_log_gets_the_name_that_is_given(tmp_path: Path) -> None:
    for number, content in enumerate((log_bytes(100), log_bytes(100)[:-8000])):
        source = tmp_path / f"{number}.mcap"
        source.write_bytes(content)
        done = recover(source, None, TRIP, quiet)
        trips = [record for record in read_log(done.path).session() if record["kind"] == "trip"]
        assert trips == [TRIP]
        end = list(read_log(done.path).session())[-1]
        assert (end["summary"]["name"], end["summary"]["place"]) == ("sea trial", "Solent")
        assert end["summary"]["boat"] == "springer"
        for item in seen(done.path.read_bytes()).others:
            assert item.metadata["name"] == "sea trial"


def test_a_recovered_log_says_of_its_trip_what_it_holds(tmp_path: Path) -> None:
    source = tmp_path / "trip.mcap"
    sound = log_bytes(100)
    wrong = sound.replace(b"\x06\0\0\0frames\x03\0\0\x00100", b"\x06\0\0\0frames\x03\0\0\x00999")
    assert wrong != sound
    source.write_bytes(wrong)
    done = recover(source, None, None, quiet)
    assert [item.metadata["frames"] for item in seen(done.path.read_bytes()).others] == ["100"]


def test_a_name_is_put_to_a_log_and_nothing_else_changes(tmp_path: Path) -> None:
    path, _ = write(tmp_path, range(50))
    before = seen(path.read_bytes())
    path.chmod(0o640)
    assert TRIP is not None
    name_log(path, TRIP, quiet)
    after = seen(path.read_bytes(), check_index=True)
    assert after.messages[: len(before.messages)] == before.messages
    trip, summary = (json.loads(message[4]) for message in after.messages[len(before.messages) :])
    assert trip == TRIP
    assert (summary["kind"], summary["name"], summary["frames"]) == ("summary", "sea trial", 50)
    (metadata,) = after.others
    assert (metadata.metadata["name"], metadata.metadata["place"]) == ("sea trial", "Solent")
    assert metadata.metadata["frames"] == "50"
    assert path.stat().st_mode & 0o777 == 0o640
    assert list(tmp_path.iterdir()) == [path]
    name_log(path, {"kind": "trip", "note": "calm"}, quiet)
    (metadata,) = seen(path.read_bytes()).others
    assert (metadata.metadata["name"], metadata.metadata["note"]) == ("sea trial", "calm")


@pytest.mark.parametrize("harm", ["damaged", "cut", "zeros", "cut in the index"])
def test_a_damaged_log_gets_no_name(tmp_path: Path, harm: str) -> None:
    path = tmp_path / "trip.mcap"
    path.write_bytes(HARMS[harm](log_bytes(100)))
    before = path.read_bytes()
    assert TRIP is not None
    with pytest.raises(WayfixError, match=r"`wayfix log recover /\S+/trip\.mcap` with the same --name"):
        name_log(path, TRIP, quiet)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_log_that_is_being_written_is_left_alone(tmp_path: Path) -> None:
    writer = new_log(tmp_path, "b", UTC_NS)
    writer.write_session(START, UTC_NS)
    assert TRIP is not None
    with pytest.raises(WayfixError, match="is being written right now; end the recording first"):
        recover(writer.path, None, None, quiet)
    with pytest.raises(WayfixError, match="is being written right now; end the recording first"):
        name_log(writer.path, TRIP, quiet)
    writer.close()
    assert list(tmp_path.iterdir()) == [writer.path]


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    source, other = tmp_path / "trip.mcap", tmp_path / "other.mcap"
    source.write_bytes(log_bytes(40))
    other.write_bytes(b"precious")
    (tmp_path / "link.mcap").symlink_to(source)
    for out, words in ((other, "exists already"), (source, "is what is read"), (tmp_path / "link.mcap", "what is")):
        with pytest.raises(WayfixError, match=words):
            recover(source, out, None, quiet)
    with pytest.raises(WayfixError, match="cannot be written"):
        recover(source, tmp_path / "no" / "out.mcap", None, quiet)
    assert other.read_bytes() == b"precious"
    assert source.read_bytes() == log_bytes(40)


@pytest.mark.parametrize("is_named", [False, True])
def test_a_full_disk_leaves_no_half_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, is_named: bool) -> None:
    source = tmp_path / "trip.mcap"
    source.write_bytes(log_bytes(100))

    def full(self: Any, *_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("mcap.writer.Writer.add_metadata", full)
    assert TRIP is not None
    trip = TRIP

    def action() -> None:
        if is_named:
            name_log(source, trip, quiet)
        else:
            recover(source, None, trip, quiet)

    with pytest.raises(WayfixError, match=r"cannot be written \(No space left on device\); free some space"):
        action()
    assert list(tmp_path.iterdir()) == [source]
    assert source.read_bytes() == log_bytes(100)


@pytest.mark.parametrize(("place", "wrong"), [(57, b"another"), (57, None), (-1, None), (-1, b"{}")])
def test_what_does_not_read_back_gets_no_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: int, wrong: bytes | None
) -> None:
    """A disk, or a library, that loses or changes one record while writing."""
    source = tmp_path / "trip.mcap"
    source.write_bytes(log_bytes(100)[:-5000])
    real, count = Writer.add_message, iter(range(10**6))
    place %= len(seen(source.read_bytes()).messages) + 1

    def lossy(self: Any, channel: int, log_time: int, data: bytes, *rest: Any) -> None:
        if next(count) == place:
            if wrong is None:
                return
            data = wrong
        real(self, channel, log_time, data, *rest)

    monkeypatch.setattr(Writer, "add_message", lossy)
    with pytest.raises(WayfixError, match="does not read back as it should"):
        recover(source, None, None, quiet)
    assert list(tmp_path.iterdir()) == [source]


def test_ctrl_c_leaves_no_half_file(tmp_path: Path) -> None:
    source = tmp_path / "trip.mcap"
    source.write_bytes(log_bytes(100))

    def interrupt(phase: str, _: object) -> None:
        if phase == "comparing":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        recover(source, None, None, interrupt)
    assert list(tmp_path.iterdir()) == [source]
