"""Records that are sound as MCAP, but not of the form of their channel: left out, counted, named, never a traceback."""

import json
import math
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgpack
import pytest
from mcap.writer import Writer

from common.errors import WayfixError
from common.messages import Frame
from shore.logbook import record_checks as forms
from shore.logbook.log_reader import LogRecord, read_log
from shore.logbook.record_checks import FormError, content_of
from shore.main import main
from shore.replay.run import Replay
from tests.station.logs import Done, log_of, rewritten

FORMATS: Final = ("csv", "gpx", "kml", "geojson", "nmea", "mcap", "parquet", "png")
SEEDS: Final = 10
EACH: Final = 0.2
"""Share of the records that are changed."""
INFINITE: Final = "@infinite"
"""Stands for 1e999: JSON, and no number of ours."""
VALUES: Final[tuple[Any, ...]] = (
    None, True, "", "text", "\x00 $\\frac$", INFINITE, [], [1], [[]], {}, {"a": []},
    0, -1, -0.5, 1e300, -1e300, 2**62, 2**64 - 1, -(2**63), math.nan, math.inf, "half a character: \ud800",
)  # fmt: skip
NO_CONTENT: Final = (b"", b"null", b"[]", b"5", b"{", b"\xff\xfe", b'"\\ud800"', b"{}", b"[" * 5000, b"\xc0", b"\x80")


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory, voyage: list[Frame]) -> Path:
    """A sound log with a record of every kind."""
    whole = log_of(tmp_path_factory.mktemp("short"), voyage[:60])
    lines: dict[str, tuple[dict[str, Any], ...]] = {
        "/session": ({"kind": "trip", "name": "Trial", "note": "calm"}, {"kind": "operator"}, {"kind": "end"}),
        "/link": ({"kind": "end", "sent": 600},),
    }
    return _with(whole, whole.with_name("short.mcap"), lines)


def _with(log: Path, path: Path, more: dict[str, tuple[dict[str, Any], ...]]) -> Path:
    """The same log with more records behind those of their topic."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="test")
        channels: dict[str, int] = {}
        records = [(each.topic, each.data, each.log_time_ns, each.publish_time_ns) for each in read_log(log).records()]
        last_ns = records[-1][2]
        added = [(topic, json.dumps(item).encode()) for topic, items in more.items() for item in items]
        records += [(topic, data, last_ns, last_ns) for topic, data in added]
        for topic, data, log_ns, publish_ns in records:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "", 0)
            writer.add_message(channels[topic], log_ns, data, publish_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def odd(data: bytes, topic: str, draw: random.Random) -> bytes:
    """One record with something wrong in it, anywhere."""
    if draw.random() < 0.1:
        return draw.choice(NO_CONTENT)
    is_frame = topic == "/frames"
    content = msgpack.unpackb(data) if is_frame else json.loads(data)
    place, key = draw.choice(list(_places(content)))
    if draw.random() < 0.25:
        del place[key]
    else:
        place[key] = draw.choice(VALUES[:-1] if is_frame else VALUES)
    if is_frame:
        return bytes(msgpack.packb(content))
    return json.dumps(content).replace(f'"{INFINITE}"', "1e999").encode()


def _places(content: Any) -> Iterator[tuple[Any, Any]]:
    for key, value in content.items() if isinstance(content, dict) else enumerate(content):
        yield content, key
        if isinstance(value, dict | list):
            yield from _places(value)


def commands(log: Path, out: Path) -> Iterator[list[str]]:
    """Everything that reads a log."""
    yield ["log", "ls", str(log), "--json"]
    yield ["log", "info", str(log), "--config", "--json"]
    yield ["log", "verify", str(log), "--json"]
    yield ["log", "recover", str(log), str(out / "recovered.mcap")]
    for kind in FORMATS:
        yield ["export", str(log), "--to", kind, str(out / f"track.{kind}"), "--json"]
    yield ["export", str(log), "--to", "csv", f"{out}/tables/"]
    yield ["export", str(log), "--to", "parquet", f"{out}/more/"]
    yield ["export", str(log), "--to", "mcap", str(out / "raw.mcap"), "--filter", "raw"]
    yield ["export", str(log), "--to", "csv", str(out / "again.csv"), "--order", "time", "--filter", "ukf"]
    yield ["replay", str(log), "--json", "--record", str(out / "new.mcap")]
    smooth = ["--smooth", str(out / "smooth.csv")]
    yield ["replay", str(log), "--order", "time", "--record", str(out / "best.mcap"), *smooth]
    yield ["log", "case", str(log), str(out / "case")]
    yield ["log", "name", str(log), "--name", "Trial"]


def check_odd_log(log: Path, out: Path, seed: int) -> None:
    """What is wrong in it hangs on `seed` alone. Raises whatever is no WayfixError."""
    draw = random.Random(seed)
    topics = sorted({record.topic for record in read_log(log).records()})
    chosen = draw.choice([topics, [draw.choice(topics)]])

    def change(record: LogRecord, number: int) -> bytes:
        is_start = record.topic == "/session" and number == 0
        is_odd = record.topic in chosen and draw.random() < (EACH if not is_start or len(chosen) == 1 else 0.05)
        return odd(record.data, record.topic, draw) if is_odd else record.data

    harmed = rewritten(log, out / "harmed.mcap", change)
    for command in commands(harmed, out):
        assert main(command) in (0, 1, 2), command


@pytest.mark.parametrize("seed", range(SEEDS))
def test_no_command_stumbles_over_odd_records(
    seed: int, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    check_odd_log(short, tmp_path, seed)
    assert "Traceback" not in "".join(capsys.readouterr())


def with_fields(log: Path, path: Path, topic: str, **fields: Any) -> Path:
    """These fields in each record of `topic`; `None` = without the field."""

    def change(record: LogRecord, _number: int) -> bytes:
        if record.topic != topic:
            return record.data
        content = json.loads(record.data) | fields
        return json.dumps({name: value for name, value in content.items() if value is not None}).encode()

    return rewritten(log, path, change)


def test_odd_records_are_counted_once_and_named(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def change(record: LogRecord, number: int) -> bytes:
        return b"null" if record.topic in ("/estimates/ukf", "/frames") and number in (3, 5) else record.data

    log = rewritten(short, tmp_path / "odd.mcap", change)
    sound, odd_log = read_log(short), read_log(log)
    rows = len(list(sound.estimates()))
    for _ in range(2):
        assert len(list(odd_log.estimates())) == rows - 2
        assert list(map(odd_log.frame, odd_log.records("/frames"))).count(None) == 2
    assert {each.topic: len(each.numbers) for each in odd_log.odd} == {"/estimates/ukf": 2, "/frames": 2}
    told = "2 records of /estimates/ukf left out, not of its form (must be an object, got None)"
    assert told in str(odd_log.damage)
    assert sound.damage is None
    assert main(["export", str(log), "--to", "csv", str(tmp_path / "track.csv"), "--json"]) == 0
    said = capsys.readouterr()
    assert told in said.err
    assert json.loads(said.out.splitlines()[-1])["rows"] == rows - 2
    assert main(["replay", str(log)]) == 0
    assert "2 records of /frames left out" in capsys.readouterr().err


def test_a_log_of_an_early_form_is_exported(short: Path, tmp_path: Path) -> None:
    """What its estimates do not say is missing, or as if nothing were waited for."""
    wanting: dict[str, Any] = dict.fromkeys(("boot_id", "waiting", "aligned", "digest", "names", "state", "covariance"))
    log = with_fields(short, tmp_path / "early.mcap", "/estimates/ukf", **wanting, cog_true_deg=None, sog_kn=None)
    early = list(read_log(log).estimates())
    assert len(early) == len(list(read_log(short).estimates())) > 40
    for kind in FORMATS:
        assert main(["export", str(log), "--to", kind, str(tmp_path / f"track.{kind}")]) == 0
    assert len((tmp_path / "track.csv").read_text(encoding="utf-8").splitlines()) == len(early) + 1


def test_an_export_of_nothing_but_odd_estimates_says_why(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = with_fields(short, tmp_path / "odd.mcap", "/estimates/ukf", lat_deg=91.5)
    assert main(["export", str(log), "--to", "gpx", str(tmp_path / "track.gpx")]) == 1
    assert "(lat_deg must be a latitude, got 91.5)); nothing was written" in capsys.readouterr().err


def test_a_session_of_another_form_is_a_sentence(short: Path, tmp_path: Path) -> None:
    log = rewritten(short, tmp_path / "null.mcap", lambda each, _: b"null" if each.topic == "/session" else each.data)
    with pytest.raises(WayfixError, match=r"has no session record.*records of /session left out, not of its form"):
        Replay(log)


def test_a_replay_counts_an_odd_estimate_as_different(short: Path, tmp_path: Path) -> None:
    done = Done(with_fields(short, tmp_path / "odd.mcap", "/estimates/ukf", sog_kn="fast", digest="none"))
    assert done.counts().different == done.counts().recorded > 40
    assert str(done.run.comparison and done.run.comparison.first).endswith("what was recorded is not of its form")


@pytest.mark.parametrize(
    ("topic", "data", "why"),
    [
        ("/events", b"{", "is no JSON"),
        ("/events", b"{} {}", "is no JSON"),
        ("/events", b"[" * 100_000, "is no JSON"),
        ("/events", b'{"text": "\\ud800"}', "holds what is no text"),
        ("/link", b'{"kind": "end", "sent": 1e999}', "holds a number that is not finite"),
        ("/link", b'{"kind": 5}', "kind must be a text, got 5"),
        (
            "/events",
            b'{"message": "m", "t_ns": 1, "code": "c", "name": "n", "level": 6}',
            "level must be one of 0 to 5",
        ),
        ("/events", b'{"t_ns": 1.0}', "t_ns must be a whole number of 64 bits, got 1.0"),
        ("/session", b'{"kind": "start", "options": []}', "options must be an object, got []"),
        (
            "/session",
            b'{"kind": "start", "connected": {"config": {"sensor": [{"id": "gps1"}, {}]}}}',
            "connected.config.sensor[1].id is missing",
        ),
        ("/estimates/kf", b'{"filter": "kf", "t_ns": 1, "lat_deg": NaN, "lon_deg": 1}', "lat_deg is missing"),
        (
            "/estimates/kf",
            b'{"filter": "kf", "t_ns": 1, "lat_deg": 1, "lon_deg": 1, "state": [1]}',
            "names, state and covariance must be of one size",
        ),
    ],
)
def test_the_reason_names_the_field(topic: str, data: bytes, why: str) -> None:
    with pytest.raises(FormError) as caught:
        content_of(topic, data)
    assert str(caught.value).startswith(why)


def test_the_quick_look_at_an_estimate_passes_nothing_that_the_whole_check_refuses(
    short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def verdicts(records: list[bytes]) -> list[str]:
        told = []
        for data in records:
            try:
                told.append(json.dumps(content_of("/estimates/ukf", data), sort_keys=True))
            except FormError:
                told.append("odd")
        return told

    draw = random.Random(7)
    (sound, *_) = read_log(short).records("/estimates/ukf")
    records = [sound.data, *(odd(sound.data, sound.topic, draw) for _ in range(3000))]
    quick = verdicts(records)
    monkeypatch.setattr(forms, "_is_quickly_sound", lambda _content: False)
    assert quick == verdicts(records)
    assert 1000 < quick.count("odd") < 2500
