"""The count of the daemon's starts survives whatever becomes of its file."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onboard.spool.segment_format import Name
from onboard.start_counter import HIGHEST, count_start
from tests.cases import CASES, needs_cases


def spooled(state: Path, *numbers: int) -> None:
    (state / "spool").mkdir(parents=True)
    for number in numbers:
        (state / "spool" / str(Name(number, 0, f"{number % 2**64:016x}"))).write_bytes(b"")


def test_it_counts() -> None:
    assert count_start(None) == (0, None, None)


def test_each_start_is_one_more(tmp_path: Path) -> None:
    assert [count_start(tmp_path / "state") for _ in range(3)] == [(1, None, None), (2, None, None), (3, None, None)]
    assert (tmp_path / "state" / "start_no").read_text() == "3\n"
    assert [each.name for each in (tmp_path / "state").iterdir()] == ["start_no"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"  \n", "is empty"),
        (b"-5\n", "holds no number of a start (b'-5"),
        (b"99999999999999999999", "holds no number of a start"),
        (b"%d" % HIGHEST, "holds no number of a start"),
        (b"12abc", "holds no number"),
        (b"\0" * 8, "holds no number"),
        ("١٢".encode(), "holds no number"),
        (b"1" * 100_000, "holds no number"),
        (b"3\n", "says 3, but the spool holds frames of start 11"),
    ],
)
def test_what_is_no_count_is_taken_from_the_spool(content: bytes, words: str, tmp_path: Path) -> None:
    spooled(tmp_path, 4, 11, 2**60)
    (tmp_path / "start_no").write_bytes(content)
    counted = count_start(tmp_path)
    assert counted.number == 12
    assert counted.mended is not None
    assert words in counted.mended
    assert counted.fault is None
    assert count_start(tmp_path) == (13, None, None)


def test_without_a_spool_it_begins_at_one(tmp_path: Path) -> None:
    (tmp_path / "start_no").write_bytes(b"-5")
    assert count_start(tmp_path).number == 1


def test_a_directory_in_its_place_is_a_fault_and_no_end(tmp_path: Path) -> None:
    spooled(tmp_path, 7)
    (tmp_path / "start_no").mkdir()
    counted = count_start(tmp_path)
    assert counted.number == 8
    assert counted.fault is not None
    assert "is a directory" in counted.fault


def test_what_a_process_of_our_number_left_is_no_hindrance(tmp_path: Path) -> None:
    (tmp_path / f".start_no.{os.getpid()}.part").write_bytes(b"9")
    assert count_start(tmp_path) == (1, None, None)


@given(content=st.binary(max_size=40))
def test_any_content_gives_a_number_that_a_frame_can_carry(
    content: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    state = tmp_path_factory.mktemp("state")
    (state / "start_no").write_bytes(content)
    assert 1 <= count_start(state).number <= HIGHEST


@needs_cases
@pytest.mark.parametrize("name", ["start_no-negative", "start_no-huge"])
def test_attack_start_no(name: str, tmp_path: Path) -> None:
    spooled(tmp_path, 11)
    (tmp_path / "start_no").write_bytes((CASES / "attack" / name).read_bytes())
    assert count_start(tmp_path).number == 12
