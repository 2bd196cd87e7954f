"""The log keeps frames byte for byte in order of arrival, and a crash costs nothing that was synced."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from common.codec import decode_frame, encode_frame
from common.errors import WayfixError
from common.events import event
from shore.logbook.log_reader import read_log
from shore.logbook.log_writer import new_log
from shore.logbook.schemas import json_schema
from shore.navigation.estimate import Estimate
from tests.station.log_files import START, UTC_NS, estimate, frame, write

REPOSITORY = Path(__file__).parents[2]


def test_frames_come_back_byte_for_byte_in_order_of_arrival(tmp_path: Path) -> None:
    order = [0, 1, 2, 9, 8, 3, 4, 5, 6, 7, *range(10, 100)]  # newest first after a gap, then the backfill
    path, _ = write(tmp_path, order)
    reader = read_log(path)
    data = list(reader.frames())
    assert data == [encode_frame(frame(seq)) for seq in order]
    assert [decode_frame(one).seq for one in data] == order
    assert reader.damage is None


def test_records_of_all_kinds_keep_their_common_order(tmp_path: Path) -> None:
    writer = new_log(tmp_path, "springer", UTC_NS)
    happening = event("link-lost", 5_000, "link", age_s=3.5)
    writer.write_session({"kind": "start"}, UTC_NS)
    writer.write_frame(b"\x80", frame(3), UTC_NS)
    writer.write_event(happening, UTC_NS)
    writer.write_estimate(estimate(7, name="ukf"), UTC_NS)
    writer.write_link({"kind": "end", "sent": 1}, UTC_NS)
    writer.write_session({"kind": "end"}, UTC_NS)
    writer.close()
    reader = read_log(writer.path)
    topics = [record.topic for record in reader.records()]
    assert topics == [
        *("/session", "/frames", "/fixes/gps1", "/events"),
        *("/estimates/ukf", "/position/ukf", "/link", "/session", "/session"),
    ]
    assert [record.publish_time_ns for record in reader.records("/frames", "/events")] == [frame(3).t1_ns, 5_000]
    (read,) = reader.events()
    assert read["text"] == happening.text
    assert read["evidence"] == {"age_s": 3.5}
    assert [one["kind"] for one in reader.session()] == ["start", "end", "summary"]


def test_estimates_are_read_by_filter_and_what_is_not_finite_is_null(tmp_path: Path) -> None:
    writer = new_log(tmp_path, "b", UTC_NS)
    nested = {"sigma": [float("inf"), 1.0], "deep": {"x": float("nan")}}
    writer.write_estimate(estimate(1, name="kf", further=nested), UTC_NS)
    writer.write_estimate(estimate(2, name="ukf"), UTC_NS)
    writer.close()
    reader = read_log(writer.path)
    (kf,) = reader.estimates("kf")
    assert kf["further"] == {"sigma": [None, 1.0], "deep": {"x": None}}
    assert [one["filter"] for one in reader.estimates()] == ["kf", "ukf"]


def test_log_time_never_goes_back_though_the_wall_clock_did(tmp_path: Path) -> None:
    writer = new_log(tmp_path, "b", UTC_NS)
    for seq, utc_ns in enumerate([UTC_NS, UTC_NS + 50, UTC_NS - 10**12, UTC_NS + 60]):
        writer.write_frame(bytes([seq]), frame(seq), utc_ns)
    writer.close()
    times = [record.log_time_ns - UTC_NS for record in read_log(writer.path).records("/frames")]
    assert times == [0, 50, 50, 60]


def test_mcaps_own_reader_opens_a_closed_log(tmp_path: Path) -> None:
    path, _ = write(tmp_path, range(30))
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        frames = [message.data for _, _, message in reader.iter_messages(topics=["/frames"])]
    assert summary is not None
    topics = {channel.topic: channel.message_encoding for channel in summary.channels.values()}
    drawn = {"/fixes/gps1": "json", "/position/fuzzy": "json"}
    assert topics == {"/session": "json", "/frames": "msgpack", "/estimates/fuzzy": "json", **drawn}
    names = {schema.name for schema in summary.schemas.values()}
    assert names == {"wayfix.Session", "wayfix.Estimate", "foxglove.LocationFix"}
    assert frames == [encode_frame(frame(seq)) for seq in range(30)]


def test_two_logs_of_the_same_second_do_not_overwrite_each_other(tmp_path: Path) -> None:
    names = []
    for boat_id in ("spr/../inger", "spr/../inger", "other"):
        writer = new_log(tmp_path / "new" / "deeper", boat_id, UTC_NS)
        writer.close()
        names.append(writer.path.name)
    assert names == [
        "20261118T110640Z-spr_inger.mcap",
        "20261118T110640Z-spr_inger-2.mcap",
        "20261118T110640Z-other.mcap",
    ]


_RECORDER = """
import sys, time
from pathlib import Path
from common.codec import encode_frame
from shore.logbook.log_writer import new_log
from tests.station.log_files import START, frame, UTC_NS
writer = new_log(Path(sys.argv[1]), "springer", UTC_NS)
writer.write_session(START, UTC_NS)
synced = time.monotonic()
for seq in range(100_000):
    one = frame(seq)
    writer.write_frame(encode_frame(one), one, time.time_ns())
    if time.monotonic() - synced >= 0.2:
        writer.sync()
        synced = time.monotonic()
        print(seq + 1, flush=True)
    time.sleep(0.002)
"""


def test_kill_9_while_recording_costs_less_than_a_second_and_nothing_that_was_synced(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _RECORDER, str(tmp_path)]
    with subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        synced = [int(process.stdout.readline()) for _ in range(4)][-1]
        (path,) = tmp_path.iterdir()
        living = read_log(path)
        assert len(list(living.frames())) >= synced
        time.sleep(0.1)
        process.send_signal(signal.SIGKILL)
        process.wait()
        killed_ns = time.time_ns()
        synced = max([synced, *(int(line) for line in process.stdout.read().splitlines())])
    assert living.is_being_written
    assert not living.losses
    assert "being written right now" in str(living.damage)
    reader = read_log(path)
    data = list(reader.frames())
    assert len(data) >= synced > 50
    assert data == [encode_frame(frame(seq)) for seq in range(len(data))]
    assert list(reader.session()) == [START]
    assert not reader.is_being_written
    assert "not closed" in str(reader.damage)
    (loss,) = reader.losses
    last_ns = max(record.log_time_ns for record in reader.records("/frames"))
    assert loss.start_ns == last_ns > killed_ns - 2 * 10**9  # a second, doubled: the machine may be busy
    assert loss.end_ns is None


def test_a_reader_knows_at_once_whether_a_log_was_closed(tmp_path: Path) -> None:
    path, _ = write(tmp_path, range(20))
    assert read_log(path).damage is None
    assert not read_log(path).is_cut
    path.write_bytes(path.read_bytes()[:-5])
    reader = read_log(path)
    assert reader.is_cut
    assert "not closed" in str(reader.damage)


def test_a_log_that_its_writer_has_open_is_no_damaged_one(tmp_path: Path) -> None:
    writer = new_log(tmp_path, "b", UTC_NS)
    writer.write_session({"kind": "start"}, UTC_NS)
    reader = read_log(writer.path)
    assert "being written right now" in str(reader.damage)
    assert len(list(reader.records())) == 1
    assert "being written right now" in str(reader.damage)
    assert not reader.losses
    assert not reader.is_cut
    writer.close()
    closed = read_log(writer.path)
    assert len(list(closed.records())) == 2
    assert closed.damage is None
    assert not closed.is_being_written


def test_a_disk_that_fails_while_reading_is_told_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _ = write(tmp_path, range(20))

    def fail(*_: object) -> bytes:
        raise OSError(5, "Input/output error")

    reader = read_log(path)
    monkeypatch.setattr("shore.logbook.mcap.source.Source.read", fail)
    with pytest.raises(WayfixError, match=r"cannot be read .Input/output error"):
        list(reader.records())


def test_events_of_the_first_form_are_read_too(tmp_path: Path) -> None:
    old = {"t_ns": 7, "source": "link", "code": "link-lost", "level": "warning", "text": "lost", "evidence": {}}
    with (tmp_path / "old.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="test")
        writer.add_message(writer.register_channel("/events", "json", 0), UTC_NS, json.dumps(old).encode(), 7)
        writer.finish()  # type: ignore[no-untyped-call]
    assert list(read_log(tmp_path / "old.mcap").events()) == [old]


_FULL_DISK = """
import resource, sys
from pathlib import Path
from common.errors import WayfixError
from shore.logbook.log_writer import new_log
from tests.station.log_files import frame, UTC_NS
import random
rng = random.Random(1)
resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))
writer = new_log(Path(sys.argv[1]), "springer", UTC_NS)
synced = 0
try:
    for seq in range(1000):
        writer.write_frame(rng.randbytes(500), frame(seq), UTC_NS)
        writer.sync()
        synced = seq + 1
except WayfixError as error:
    print(synced, error)
try:
    writer.write_frame(b"", frame(0), UTC_NS)
except WayfixError as error:
    print(error)
writer.close()
writer.close()
"""


def test_a_full_disk_is_told_once_and_what_was_synced_stays_readable(tmp_path: Path) -> None:
    command = [sys.executable, "-X", "dev", "-W", "error", "-c", _FULL_DISK, str(tmp_path)]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=True, timeout=60)
    first, second = done.stdout.splitlines()
    assert done.stderr == ""
    assert "the log cannot be written any further" in first
    assert "free some space" in first
    assert "ended with an earlier fault" in second
    (path,) = tmp_path.iterdir()
    assert len(list(read_log(path).frames())) >= int(first.split()[0]) > 30


def test_a_directory_that_cannot_be_made_is_told_in_one_sentence(tmp_path: Path) -> None:
    blocked = tmp_path / "a_file"
    blocked.write_text("x")
    for directory in (blocked, blocked / "below"):
        with pytest.raises(WayfixError, match=r"a_file.*no log can be written here.*directory you may write to"):
            new_log(directory, "b", UTC_NS)
    assert list(tmp_path.iterdir()) == [blocked]


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "cannot be read"), (b"", "the file is empty"), (b"t_s,lat_deg\n1,50\n", "not an MCAP log")],
)
def test_what_is_no_log_is_told_in_one_sentence(tmp_path: Path, content: bytes | None, words: str) -> None:
    path = tmp_path / "x.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(WayfixError, match=words) as caught:
        read_log(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_directory_in_place_of_a_log_is_told(tmp_path: Path) -> None:
    with pytest.raises(WayfixError, match="cannot be read"):
        read_log(tmp_path)


def test_a_pipe_and_a_device_are_no_logs(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(WayfixError, match="is no plain file"):
            read_log(path)


def test_a_session_record_is_on_the_disk_at_once(tmp_path: Path) -> None:
    writer = new_log(tmp_path, "b", UTC_NS)
    writer.write_session({"kind": "start"}, UTC_NS)
    assert list(read_log(writer.path).session()) == [{"kind": "start"}]
    writer.close()


def test_the_schema_of_estimates_names_every_field_of_an_estimate() -> None:
    _, schema = json_schema("/estimates/fuzzy")
    assert set(json.loads(schema)["properties"]) == {
        *(field.name for field in dataclasses.fields(Estimate)),
        "digest",
    }
