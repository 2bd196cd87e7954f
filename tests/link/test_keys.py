"""Key pairs in files, fingerprints, and the lists of keys that say whom to trust."""

import os
import stat
import threading
from pathlib import Path

import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from common.errors import WayfixError
from common.key_list import Entry, entries_of, entry_of, name_fault, with_entry, without
from common.keys import crockford, fingerprint, key_text, new_keys, own_keys, raw_key, write_own
from onboard.link.allow_list import READ, AllowList

RAW = st.binary(min_size=32, max_size=32).filter(lambda raw: any(raw[1:-1]))
NAMES = st.text(min_size=1, max_size=64).filter(lambda name: name_fault(name) is None)
KEY = "rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7"


def mode_of(file: Path) -> int:
    return stat.S_IMODE(file.stat().st_mode)


def test_the_key_is_made_once_and_only_its_owner_may_read_it(tmp_path: Path) -> None:
    file = tmp_path / "new" / "secret-key"
    keys = own_keys(file)
    assert own_keys(file) == keys
    assert zmq.curve_public(keys.secret) == keys.public
    assert mode_of(file) == 0o600
    assert mode_of(file.parent) == 0o700
    assert [found.name for found in file.parent.iterdir()] == ["secret-key"]
    assert file.read_bytes() == keys.secret + b"\n"


def test_the_secret_is_not_shown() -> None:
    keys = new_keys()
    assert keys.secret.decode() not in repr(keys)


def test_of_programs_that_start_at_once_all_have_the_same_key(tmp_path: Path) -> None:
    found = []
    start = threading.Barrier(8)

    def begin() -> None:
        start.wait()
        found.append(own_keys(tmp_path / "secret-key"))

    threads = [threading.Thread(target=begin) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(found)) == 1
    assert len(found) == 8
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o660, 0o601])
def test_a_key_that_others_may_reach_is_refused(tmp_path: Path, mode: int) -> None:
    file = tmp_path / "secret-key"
    own_keys(file)
    before = file.read_bytes()
    file.chmod(mode)
    with pytest.raises(WayfixError, match=f"others have rights to it \\(mode 0{mode:o}\\)"):
        own_keys(file)
    assert file.read_bytes() == before


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\n",
        b"secret\n",
        KEY.encode()[:-1],
        KEY.encode() + b"\n\n",
        KEY.encode() + b" ",
        b"\xff" * 40,
        b"#" * 40,
        bytes(40),
    ],
)
def test_garbage_is_refused_and_kept(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "secret-key"
    write_own(file, content)
    with pytest.raises(WayfixError, match="is no secret key"):
        own_keys(file)
    assert file.read_bytes() == content


@given(content=st.binary(max_size=300))
def test_any_file_is_a_key_or_refused_with_a_sentence(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    file = tmp_path_factory.mktemp("key") / "secret-key"
    write_own(file, content)
    with pytest.raises(WayfixError) as caught:
        own_keys(file)
    assert str(caught.value).startswith(str(file))


def test_what_is_no_plain_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    (tmp_path / "folder").mkdir()
    (tmp_path / "nowhere").symlink_to(tmp_path / "folder" / "missing" / "key")
    for name in ("pipe", "folder", "nowhere"):
        with pytest.raises(WayfixError):
            own_keys(tmp_path / name)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_a_key_of_another_user_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "secret-key"
    own_keys(file)
    os.chown(file, 65534, 65534)
    with pytest.raises(WayfixError, match="belongs to user number 65534"):
        own_keys(file)


def test_a_directory_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(WayfixError, match=r"no secret key can be made|cannot be read"):
        own_keys(tmp_path / "file" / "secret-key")


@given(raw=RAW)
def test_a_key_survives_its_text(raw: bytes) -> None:
    text = key_text(raw)
    assert raw_key(text) == raw
    assert len(text) == 40
    assert len(fingerprint(text)) == 19


@pytest.mark.parametrize("point", [0, 1, 2**255 - 20, 2**255 - 19, 2**255 - 18, 2**255 + 1])
def test_a_key_with_which_nobody_has_a_secret_is_none(point: int, tmp_path: Path) -> None:
    text = key_text(point.to_bytes(32, "little"))
    assert raw_key(text) is None
    with pytest.raises(WayfixError, match="not a key"):
        AllowList(tmp_path).add(text, "laptop", READ)


@given(text=st.text(alphabet=st.characters(codec="utf-8"), max_size=50))
def test_other_texts_are_no_keys(text: str) -> None:
    raw = raw_key(text)
    assert raw is None or key_text(raw) == text
    assert set(fingerprint(text)) <= set("0123456789ABCDEFGHJKMNPQRSTVWXYZ-")


def test_no_key_beyond_its_numbers() -> None:
    assert raw_key("#" * 40) is None  # 85^5 - 1 is more than 2^32
    assert raw_key(f"{KEY}\n") is None
    assert fingerprint(KEY) != fingerprint(key_text(bytes(32)))
    assert crockford(2**60 - 1, 12) == "ZZZZ-ZZZZ-ZZZZ"
    assert crockford(33, 12) == "0000-0000-0011"


def read(text: str) -> tuple[list[Entry], list[str]]:
    return entries_of(text, lambda word: None if word in ("read", "read,command") else "has no such rights")


def test_a_list_of_keys() -> None:
    hash_key = key_text(b"\xff\xff\xff\xff" + bytes(28)).replace("%", "%")
    text = (
        f"# who\n\n{KEY} read laptop\n{KEY[1:]} read cut\n{hash_key} read,command bridge  \r\n  {KEY}\tread  tab let\n"
    )
    entries, faults = read(text + f"{KEY} write thief\n{KEY} read\nnonsense")
    assert [entry.name for entry in entries] == ["laptop", "bridge", "tab let"]
    assert [fault.split(":")[0].split(" ")[1] for fault in faults] == ["4", "7", "8", "9"]


@given(raw=RAW)
def test_no_key_is_taken_for_a_comment(raw: bytes) -> None:
    entry = Entry(key_text(raw), "read", "x")
    assert read(entry.line) == ([entry], [])


@given(text=st.text(alphabet=st.characters(), max_size=400))
def test_any_text_is_read(text: str) -> None:
    entries, faults = read(text)
    lines = [line for line in text.split("\n") if line.strip() and not line.lstrip().startswith("#")]
    assert len(entries) + len(faults) == len(lines)


@given(
    lines=st.lists(st.tuples(RAW, st.sampled_from(["read", "read,command"]), NAMES), max_size=6),
    noise=st.text(max_size=80),
)
def test_lines_are_replaced_and_removed_and_nothing_else_is_lost(
    lines: list[tuple[bytes, str, str]], noise: str
) -> None:
    noise = noise.replace("\n", "")
    text = f"# {noise}\n"
    expected: dict[str, Entry] = {}
    for raw, word, name in lines:
        entry = Entry(key_text(raw), word, name)
        text = with_entry(text, entry)
        expected.pop(entry.key, None)
        expected[entry.key] = entry
        assert entry_of(entry.line) == entry
    assert read(text) == (list(expected.values()), [])
    for key in list(expected):
        text = without(text, [key])
        del expected[key]
        assert read(text) == (list(expected.values()), [])
    assert text == f"# {noise}\n"
