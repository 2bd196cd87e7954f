"""A file appears when it is whole, or not at all."""

from pathlib import Path

import pytest

from common.atomic_file import check_target, whole_file
from common.errors import WayfixError


def test_it_takes_the_place_of_the_old_one_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"old")
    with whole_file(path) as stream:
        stream.write(b"new")
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_a_fault_leaves_the_old_one_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"old")

    def interrupted() -> None:
        with whole_file(path) as stream:
            stream.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_target_is_never_an_input_a_directory_or_nowhere(tmp_path: Path) -> None:
    source = tmp_path / "log.mcap"
    source.touch()
    link = tmp_path / "link.csv"
    link.symlink_to(source)
    check_target(tmp_path / "new.csv", [source, tmp_path / "absent"], "choose another")
    check_target(tmp_path / "link2.csv", [], "choose another")
    for target, words in (
        (source, "it would be lost"),
        (link, "it would be lost"),
        (tmp_path, "cannot be written"),
        (tmp_path / "no" / "a.csv", "cannot be written"),
        (Path("/dev/full"), "cannot be written"),
    ):
        with pytest.raises(WayfixError, match=words):
            check_target(target, [source], "choose another")
