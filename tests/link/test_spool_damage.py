"""Files cut, zeroed and flipped: what is whole is read, `verify` names the rest, no wrong frame is ever given."""

import random
from pathlib import Path

import pytest

from onboard.spool import writer
from onboard.spool.segment_index import segments_in
from onboard.spool.verify import Examination, frames_of
from tests.link.spooling import filled, identity, payload, read_all, spool_at

BOOT = identity().boot_id
COUNT = 60
SEGMENT = 5000


@pytest.fixture
def originals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[Path, bytes]:
    """One start of 60 frames in three segments."""
    monkeypatch.setattr(writer, "SEGMENT_BYTES", SEGMENT)
    filled(tmp_path / "spool", COUNT)
    files = {path: path.read_bytes() for path in sorted((tmp_path / "spool").glob("*.seg"))}
    assert len(files) == 3
    return files


def examined(directory: Path) -> Examination:
    examination = Examination(segments_in(directory), is_live=False)
    examination.run()
    return examination


def check(directory: Path) -> set[int]:
    """The frames that are lost; every reader says the same, and `verify` names them."""
    there = dict(frames_of(segments_in(directory)))
    assert all(data == payload(seq) for seq, data in there.items())
    lost = set(range(COUNT)) - there.keys()
    examination = examined(directory)
    named: set[int] = set()
    for finding in examination.findings:
        if finding.lost is not None:
            first, last = finding.lost
            named.update(range(first, COUNT if last is None else last + 1))
    assert named == lost
    assert examination.frames == len(there)
    spool = spool_at(directory, 2)
    frames, gone = read_all(spool, BOOT, 0, COUNT - 1, 1500)
    spool.close(1.0)
    assert frames == there
    assert gone == lost
    return lost


def test_whole(originals: dict[Path, bytes]) -> None:
    directory = next(iter(originals)).parent
    assert check(directory) == set()
    assert examined(directory).findings == []


def cut_or_zero(originals: dict[Path, bytes], seed: int, rounds: int) -> None:
    draw = random.Random(seed)
    for _ in range(rounds):
        path = draw.choice(list(originals))
        data = originals[path]
        at = draw.randrange(len(data))
        harmed = data[:at] + bytes(len(data) - at if draw.random() < 0.5 else draw.choice((0, 0, 3, 4096)))
        path.write_bytes(harmed)
        lost = check(path.parent)
        # Everything before the damage is read: whole are the records that end before it.
        whole = {seq for seq in range(COUNT) if payload(seq) in data[:at]}
        in_file = {seq for seq in range(COUNT) if payload(seq) in data}
        if at > 300:  # behind the header
            assert lost == in_file - whole
        findings = examined(path.parent).findings
        assert findings
        if lost and path is not list(originals)[-1]:
            assert any(finding.is_damage for finding in findings)
        path.write_bytes(data)


def test_cuts_and_zeros(originals: dict[Path, bytes]) -> None:
    cut_or_zero(originals, 1, 60)


@pytest.mark.slow
def test_a_thousand_cuts_and_zeros(originals: dict[Path, bytes]) -> None:
    cut_or_zero(originals, 2, 1000)


def flips(originals: dict[Path, bytes], seed: int, rounds: int) -> None:
    draw = random.Random(seed)
    for _ in range(rounds):
        path = draw.choice(list(originals))
        harmed = bytearray(originals[path])
        hits = draw.choice((1, 1, 1, 2, 5))
        for _ in range(hits):
            harmed[draw.randrange(len(harmed))] ^= 1 << draw.randrange(8)
        if harmed == originals[path]:
            continue
        path.write_bytes(harmed)
        assert len(check(path.parent)) <= hits
        assert any(finding.is_damage for finding in examined(path.parent).findings)
        path.write_bytes(originals[path])


def test_flipped_bits(originals: dict[Path, bytes]) -> None:
    flips(originals, 3, 100)


@pytest.mark.slow
def test_two_thousand_flipped_bits(originals: dict[Path, bytes]) -> None:
    flips(originals, 4, 2000)


def test_a_missing_segment(originals: dict[Path, bytes]) -> None:
    path = list(originals)[1]
    path.unlink()
    lost = check(path.parent)
    assert lost == {seq for seq in range(COUNT) if payload(seq) in originals[path]}
    assert [str(finding).split(": ", 1)[1] for finding in examined(path.parent).findings] == [
        f"cut before it, or a file is missing; lost: frames {min(lost)} to {max(lost)}"
    ]


def test_a_segment_of_another_start_under_a_false_name(originals: dict[Path, bytes]) -> None:
    """Its frames have right numbers and whole records; they are not taken."""
    paths = list(originals)
    paths[0].rename(paths[0].with_name(paths[0].name.replace(BOOT, "f" * 16)))
    directory = paths[0].parent
    assert len(dict(frames_of(segments_in(directory)[:1]))) == 0
    held = [segment for segment in segments_in(directory) if segment.name.boot_id == "f" * 16]
    examination = Examination(held, is_live=False)
    examination.run()
    assert any("name" in finding.what for finding in examination.findings)
