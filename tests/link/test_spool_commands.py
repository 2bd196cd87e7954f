"""`wayfix-onboard spool ls|verify|export`, on spools at rest and while a daemon writes."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from common.codec import decode_frame, encode_frame
from common.frames_file import FramesFile
from common.messages import Frame
from onboard.journal import Journal
from onboard.main import main
from onboard.spool import Spool
from tests.link.spooling import QUICK, Told, identity, until

UTC_NS = 1_795_000_000 * 10**9
ABOUT = {"config": {"boat": {"id": "springer"}, "sensor": []}, "versions": {"wayfix": "0"}}


def real_frame(seq: int, start_no: int, *, dated: bool) -> bytes:
    who = identity(start_no)
    t0_ns = 10**12 + seq * 10**8
    return encode_frame(
        Frame(
            boat_id=who.boat_id,
            boot_id=who.boot_id,
            seq=seq,
            clock_id=who.clock_id,
            start_no=start_no,
            t0_ns=t0_ns,
            t1_ns=t0_ns + 10**8,
            utc_ns=UTC_NS + seq * 10**8 if dated else None,
            utc_src="gnss" if dated else "none",
        )
    )


def sailed(state: Path, start_no: int, count: int, *, dated_from: int = 0, about: Any = ABOUT) -> Spool:
    """A start of `count` frames whose daemon still lives; time is known from frame `dated_from` on."""
    spool = Spool(state / "spool", identity(start_no), QUICK, Journal(Told(), lambda: 0), about=about)
    for seq in range(count):
        spool.append(seq, real_frame(seq, start_no, dated=seq >= dated_from))
    until(lambda: spool.synced_seq == count - 1)
    return spool


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any], str]:
    code = main(["spool", *arguments, "--json"])
    output = capsys.readouterr()
    lines = output.out.splitlines()
    return code, json.loads(lines[-1]) if lines else {}, output.out + output.err


def digests(directory: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in directory.iterdir()}


def test_ls(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sailed(tmp_path, 1, 30, dated_from=20).close(5.0)
    sailed(tmp_path, 2, 10, dated_from=10).close(5.0)
    live = sailed(tmp_path, 3, 50)
    before = digests(tmp_path / "spool")
    code, found, text = run(capsys, "ls", "--state", str(tmp_path))
    assert code == 0
    assert "being written" in text
    assert digests(tmp_path / "spool") == before
    assert [(row["start_no"], row["first"], row["last"]) for row in found["starts"]] == [
        (1, 0, 29),
        (2, 0, 9),
        (3, 0, 49),
    ]
    assert [row["from"] for row in found["starts"]] == ["2026-11-18T11:06:40", None, "2026-11-18T11:06:40"]
    assert found["starts"][0]["to"] == "2026-11-18T11:06:43"  # its first frames are dated by the last ones
    live.close(5.0)
    assert "being written" not in run(capsys, "ls", "--state", str(tmp_path))[2]


def test_verify(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sailed(tmp_path, 1, 30).close(5.0)
    live = sailed(tmp_path, 2, 30)
    code, found, text = run(capsys, "verify", "--state", str(tmp_path))
    assert (code, found["frames"], found["findings"]) == (0, 60, [])
    assert "nothing is damaged" in text
    old, new = sorted((tmp_path / "spool").glob("*.seg"))
    with new.open("ab") as stream:  # a frame on its way into the file
        stream.write(b"\xf5WFR\0\0")
    assert run(capsys, "verify", "--state", str(tmp_path))[0] == 0
    data = bytearray(old.read_bytes())
    data[data.index(real_frame(7, 1, dated=True))] ^= 1
    old.write_bytes(data)
    code, found, text = run(capsys, "verify", "--state", str(tmp_path))
    assert (code, found["frames"]) == (1, 59)
    assert [finding["lost"] for finding in found["findings"]] == [[7, 7]]
    assert "frames 7 to 7" in text
    live.close(5.0)
    assert run(capsys, "verify", "--state", str(tmp_path))[0] == 1


def test_verify_of_a_run_that_was_killed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No goodbye is a remark, not damage: boats are switched off."""
    sailed(tmp_path, 1, 30).close(5.0)
    (file,) = (tmp_path / "spool").glob("*.seg")
    file.write_bytes(file.read_bytes()[:-24])
    code, found, _ = run(capsys, "verify", "--state", str(tmp_path))
    assert code == 0
    assert [(finding["lost"], finding["damage"]) for finding in found["findings"]] == [([30, None], False)]


def exported(path: Path) -> tuple[dict[str, Any], list[int]]:
    with FramesFile(path) as file:
        seqs = [decode_frame(data).seq for data in file.frames()]
        assert file.cut is None
        return file.greeting, seqs


def test_export(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sailed(tmp_path, 1, 30).close(5.0)
    live = sailed(tmp_path, 2, 20)
    out = tmp_path / "out.frames"
    code, found, _ = run(capsys, "export", str(out), "--state", str(tmp_path))
    assert (code, found["frames"], found["missing"]) == (0, 20, 0)
    greeting, seqs = exported(out)
    assert seqs == list(range(20))
    assert greeting["boot_id"] == identity(2).boot_id
    assert greeting["config"] == ABOUT["config"]
    boot = identity(1).boot_id
    asked = ("export", str(out), "--state", str(tmp_path), "--boot", boot, "--from", "5", "--to", "9")
    assert run(capsys, *asked)[0] == 0
    assert exported(out)[1] == [5, 6, 7, 8, 9]
    file = min((tmp_path / "spool").glob("*.seg"))
    data = bytearray(file.read_bytes())
    data[data.index(real_frame(7, 1, dated=True))] ^= 1
    file.write_bytes(data)
    code, found, _ = run(capsys, *asked)
    assert (code, found["frames"], found["missing"]) == (1, 4, 1)
    assert exported(out)[1] == [5, 6, 8, 9]
    live.close(5.0)


def test_export_without_a_configuration_in_the_spool(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sailed(tmp_path, 1, 3, about={}).close(5.0)
    out = tmp_path / "out.frames"
    code, _, text = run(capsys, "export", str(out), "--state", str(tmp_path))
    assert code == 2
    assert "--config" in text
    assert not out.exists()
    example = Path(__file__).parents[2] / "deploy" / "examples" / "boat.toml"
    assert run(capsys, "export", str(out), "--state", str(tmp_path), "--config", str(example))[0] == 0
    assert [sensor["id"] for sensor in exported(out)[0]["sensors"]] == ["gps1", "imu1", "compass1"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("ls",), "there is no spool here"),
        (("verify",), "there is no spool here"),
        (("export", "OUT", "--boot", "77"), "holds no starts 77"),
        (("export", "OUT", "--from", "30"), "has no such frames"),
        (("export", "OUT/none/x"), "cannot be written"),
        (("export", "FOREIGN"), "is no frames file"),
    ],
)
def test_refusals(tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], words: str) -> None:
    state = tmp_path / "state"
    if words != "there is no spool here":
        sailed(state, 1, 30).close(5.0)
    (tmp_path / "FOREIGN").write_text("mine")
    places = {"OUT": str(tmp_path / "out"), "FOREIGN": str(tmp_path / "FOREIGN")}
    given = [places.get(item, item.replace("OUT/", f"{tmp_path}/out/")) for item in arguments]
    code, _, text = run(capsys, *given, "--state", str(state))
    assert code == 2
    assert words in text
    assert text.count("\n") == 1
    assert (tmp_path / "FOREIGN").read_text() == "mine"


def test_where_the_state_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    sailed(tmp_path, 1, 3).close(5.0)
    monkeypatch.setenv("STATE_DIRECTORY", f"{tmp_path}:/elsewhere")
    assert run(capsys, "ls")[1]["segments"] == 1
