"""The log keeps frames byte for byte in order of arrival, and a crash costs nothing that was synced."""

import dataclasses
import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader

from common.codec import decode_frame, encode_frame
from common.errors import WayfixError
from common.events import event
from common.messages import Fix, Frame
from shore.logbook.read import read_log
from shore.logbook.record import LogWriter
from shore.logbook.schemas import json_schema
from shore.navigation.estimate import Estimate
from tests.strategies import frame_of

UTC_NS = 1_795_000_000_000_000_000
REPOSITORY = Path(__file__).parents[2]


def frame(seq: int) -> Frame:
    t0_ns = 1_000_000_000 + 100_000_000 * seq
    fix = Fix(sensor="gps1", t_ns=t0_ns, lat_deg=50.0 + seq / 1e4, lon_deg=-4.0)
    return frame_of(fix, seq=seq, t0_ns=t0_ns, t1_ns=t0_ns + 100_000_000)


def write(directory: Path, order: list[int], sync_each: int = 10) -> tuple[Path, list[tuple[int, int]]]:
    """A closed log; and (file size, frames readable then) after each sync."""
    writer = LogWriter(directory, "springer", UTC_NS)
    writer.write_session({"kind": "start", "options": {"filters": ["fuzzy"]}}, UTC_NS)
    synced = [(writer.path.stat().st_size, 0)]
    for count, seq in enumerate(order, 1):
        one = frame(seq)
        writer.write_frame(encode_frame(one), one, UTC_NS + count)
        writer.write_estimate(
            {"filter": "fuzzy", "t_ns": one.t1_ns, "lat_deg": 50.0, "bad": float("nan")}, UTC_NS + count
        )
        if count % sync_each == 0:
            writer.sync()
            synced.append((writer.path.stat().st_size, count))
    writer.close()
    return writer.path, synced


def test_frames_come_back_byte_for_byte_in_order_of_arrival(tmp_path: Path) -> None:
    order = [0, 1, 2, 9, 8, 3, 4, 5, 6, 7, *range(10, 100)]  # newest first after a gap, then the backfill
    path, _ = write(tmp_path, order)
    reader = read_log(path)
    data = list(reader.frames())
    assert data == [encode_frame(frame(seq)) for seq in order]
    assert [decode_frame(one).seq for one in data] == order
    assert reader.damage is None


def test_records_of_all_kinds_keep_their_common_order(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path, "springer", UTC_NS)
    happening = event("link-lost", 5_000, "link", age_s=3.5)
    writer.write_session({"kind": "start"}, UTC_NS)
    writer.write_frame(b"\x80", frame(3), UTC_NS)
    writer.write_event(happening, UTC_NS)
    writer.write_estimate({"filter": "ukf", "t_ns": 7}, UTC_NS)
    writer.write_link({"kind": "end", "sent": 1}, UTC_NS)
    writer.write_session({"kind": "end"}, UTC_NS)
    writer.close()
    reader = read_log(writer.path)
    topics = [record.topic for record in reader.records()]
    assert topics == ["/session", "/frames", "/events", "/estimates/ukf", "/link", "/session"]
    assert [record.publish_time_ns for record in reader.records("/frames", "/events")] == [frame(3).t1_ns, 5_000]
    (read,) = reader.events()
    assert read["text"] == happening.text
    assert read["evidence"] == {"age_s": 3.5}
    assert list(reader.session()) == [{"kind": "start"}, {"kind": "end"}]


def test_estimates_are_read_by_filter_and_what_is_not_finite_is_null(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path, "b", UTC_NS)
    nested = {"sigma": [float("inf"), 1.0], "deep": {"x": float("nan")}}
    writer.write_estimate({"filter": "kf", "t_ns": 1, **nested}, UTC_NS)
    writer.write_estimate({"filter": "ukf", "t_ns": 2}, UTC_NS)
    writer.close()
    reader = read_log(writer.path)
    assert list(reader.estimates("kf")) == [{"filter": "kf", "t_ns": 1, "sigma": [None, 1.0], "deep": {"x": None}}]
    assert [one["filter"] for one in reader.estimates()] == ["kf", "ukf"]


def test_log_time_never_goes_back_though_the_wall_clock_did(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path, "b", UTC_NS)
    for seq, utc_ns in enumerate([UTC_NS, UTC_NS + 50, UTC_NS - 10**12, UTC_NS + 60]):
        writer.write_frame(bytes([seq]), frame(seq), utc_ns)
    writer.close()
    times = [record.log_time_ns - UTC_NS for record in read_log(writer.path).records()]
    assert times == [0, 50, 50, 60]


def test_mcaps_own_reader_opens_a_closed_log(tmp_path: Path) -> None:
    path, _ = write(tmp_path, list(range(30)))
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        frames = [message.data for _, _, message in reader.iter_messages(topics=["/frames"])]
    assert summary is not None
    topics = {channel.topic: channel.message_encoding for channel in summary.channels.values()}
    assert topics == {"/session": "json", "/frames": "msgpack", "/estimates/fuzzy": "json"}
    assert {schema.name for schema in summary.schemas.values()} == {"wayfix.Session", "wayfix.Estimate"}
    assert frames == [encode_frame(frame(seq)) for seq in range(30)]


def test_two_logs_of_the_same_second_do_not_overwrite_each_other(tmp_path: Path) -> None:
    names = []
    for boat_id in ("spr/../inger", "spr/../inger", "other"):
        writer = LogWriter(tmp_path / "new" / "deeper", boat_id, UTC_NS)
        writer.close()
        names.append(writer.path.name)
    assert names == [
        "20261118T110640Z-spr_inger.mcap",
        "20261118T110640Z-spr_inger-2.mcap",
        "20261118T110640Z-other.mcap",
    ]


def test_a_log_cut_anywhere_opens_and_keeps_what_was_synced_before_the_cut(tmp_path: Path) -> None:
    path, synced = write(tmp_path, list(range(300)))
    whole = path.read_bytes()
    rng = random.Random(2)
    cut_file = tmp_path / "cut.mcap"
    for cut in [1, 8, len(whole) - 1, *(rng.randrange(1, len(whole)) for _ in range(200))]:
        cut_file.write_bytes(whole[:cut])
        reader = read_log(cut_file)
        data = list(reader.frames())
        certain = max((count for size, count in synced if size <= cut), default=0)
        assert len(data) >= certain
        assert data == [encode_frame(frame(seq)) for seq in range(len(data))]
        assert reader.damage is not None


def test_a_damaged_byte_ends_the_log_with_a_word_and_never_gives_wrong_frames(tmp_path: Path) -> None:
    path, _ = write(tmp_path, list(range(100)))
    whole = path.read_bytes()
    rng = random.Random(3)
    noticed = 0
    for _ in range(200):
        broken = bytearray(whole)
        broken[rng.randrange(100, len(whole) - 20)] ^= 0xFF
        path.write_bytes(broken)
        reader = read_log(path)
        data = list(reader.frames())
        assert data == [encode_frame(frame(seq)) for seq in range(len(data))]
        noticed += reader.damage is not None
        assert len(data) == 100 or reader.damage is not None
    assert noticed > 100


_RECORDER = """
import sys, time
from pathlib import Path
from common.codec import encode_frame
from shore.logbook.record import LogWriter
from shore.logbook.schemas import json_schema
from shore.navigation.estimate import Estimate
from tests.station.test_logbook import frame, UTC_NS
writer = LogWriter(Path(sys.argv[1]), "springer", UTC_NS)
writer.write_session({"kind": "start"}, UTC_NS)
synced = time.monotonic()
for seq in range(100_000):
    one = frame(seq)
    writer.write_frame(encode_frame(one), one, UTC_NS + seq)
    if time.monotonic() - synced >= 0.2:
        writer.sync()
        synced = time.monotonic()
        print(seq + 1, flush=True)
    time.sleep(0.002)
"""


def test_kill_9_while_recording_loses_nothing_that_was_synced(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _RECORDER, str(tmp_path)]
    with subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        synced = [int(process.stdout.readline()) for _ in range(4)][-1]
        time.sleep(0.1)
        process.send_signal(signal.SIGKILL)
        process.wait()
        synced = max([synced, *(int(line) for line in process.stdout.read().splitlines())])
    (path,) = tmp_path.iterdir()
    reader = read_log(path)
    data = list(reader.frames())
    assert len(data) >= synced > 50
    assert data == [encode_frame(frame(seq)) for seq in range(len(data))]
    assert list(reader.session()) == [{"kind": "start"}]
    assert reader.damage is not None
    assert "not closed" in reader.damage


_FULL_DISK = """
import resource, sys
from pathlib import Path
from common.errors import WayfixError
from shore.logbook.record import LogWriter
from shore.logbook.schemas import json_schema
from shore.navigation.estimate import Estimate
from tests.station.test_logbook import frame, UTC_NS
import dataclasses
import json
import random
rng = random.Random(1)
resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))
writer = LogWriter(Path(sys.argv[1]), "springer", UTC_NS)
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
            LogWriter(directory, "b", UTC_NS)
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


def test_a_session_record_is_on_the_disk_at_once(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path, "b", UTC_NS)
    writer.write_session({"kind": "start"}, UTC_NS)
    assert list(read_log(writer.path).session()) == [{"kind": "start"}]
    writer.close()


def test_the_schema_of_estimates_names_every_field_of_an_estimate() -> None:
    _, schema = json_schema("/estimates/fuzzy")
    assert set(json.loads(schema)["properties"]) == {field.name for field in dataclasses.fields(Estimate)}
