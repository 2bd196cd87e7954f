"""`wayfix.toml`: each fault is a sentence and nothing is written; the command line wins; a log says what was used."""

import json
import os
import re
import tomllib
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages import LEVELS
from common.settings import as_dict
from shore.logbook.log_reader import read_log
from shore.main import main
from shore.replay.run import Replay
from shore.settings.command import lines_of
from shore.settings.station import DEFAULTS, DisplaySettings, LimitSettings, StationSettings, station_settings
from shore.watchers.watcher import Watchers
from tests.recordings import REPOSITORY
from tests.station.imports import tpv

GPSD = "\n".join(tpv(second, lat=60.0 + 1e-5 * second, lon=24.0, speed=4.0, track=0.0) for second in range(30))
STEPPED = b'[filter]\nnames = ["ukf", "fuzzy"]\nstep_s = 2\n'
TABLES = ("filter", "limits", "display", "log")


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the station looks; nothing is there yet."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    path = tmp_path / "config" / "wayfix" / "wayfix.toml"
    path.parent.mkdir(parents=True)
    return path


class Here:
    """`wayfix import` and `wayfix replay` in a directory."""

    def __init__(self, directory: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.directory = directory
        self.recording = directory / "in.log"
        self.recording.write_text(GPSD)
        self._capsys = capsys

    def import_it(self, *options: str) -> Path:
        out = self.directory / "out.mcap"
        out.unlink(missing_ok=True)
        assert main(["import", str(self.recording), str(out), *options]) == 0
        return out

    def words_of(self, *arguments: object) -> tuple[int, str, str]:
        self._capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        return code, *self._capsys.readouterr()


@pytest.fixture
def here(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Here:
    return Here(tmp_path, capsys)


def options_of(log: Path) -> dict[str, Any]:
    options: dict[str, Any] = next(read_log(log).session())["options"]
    return options


def estimates_of(log: Path) -> list[dict[str, Any]]:
    return list(read_log(log).estimates())


FAULTS = [
    (b"[filters]\n", ["filters: unknown key, did you mean filter?"]),
    (b"[limits]\nlink_lost = 4\n", ["limits.link_lost: unknown key, did you mean link_lost_s?"]),
    (b"[display]\ncolour = 'red'\n", ["display.colour: unknown key (known: status_line, events_from)"]),
    (b"[limits]\nlink_lost_s = '4'\n", ["limits.link_lost_s: must be a number, got '4'"]),
    (b"[display]\nstatus_line = 1\n", ["display.status_line: must be true or false, got 1"]),
    (b"filter = 3\n", ["filter: must be a table"]),
    (b"[filter]\nnames = 'ukf'\n", ["filter.names: must be a list, got 'ukf'"]),
    (b"[filter]\nnames = [3]\n", ["filter.names[1]: must be a text, got 3"]),
    (b"[filter]\nnames = []\n", ["filter.names: must hold at least one"]),
    (b"[filter]\nnames = ['ukf', 'kf', 'ukf']\n", ["filter.names: holds 'ukf' twice"]),
    (b"[filter]\nstep_s = 0\n", ["filter.step_s: must be >= 0.05, got 0"]),
    (b"[filter]\nstep_s = nan\n", ["filter.step_s: must be finite, got nan"]),
    (b"[filter]\nstep_s = 1" + b"0" * 400, ["filter.step_s: must be finite, got inf"]),
    (b"[limits]\nlink_lost_s = 61\n", ["limits.link_lost_s: must be <= 60, got 61"]),
    (b"[display]\nevents_from = 'warn'\n", ["must be one of debug, info, warning, error, got 'warn'"]),
    (b"[filter]\n\nnames = [\n", ["is not valid TOML:"]),
    (b"[filter]\nnames = 3 4\n", ["is not valid TOML: ", "(at line 2, column 11)"]),
    (b"[filter]\n# Gr\xfc\xdfe\n", ["is not valid TOML: byte 0xfc in line 2 is no UTF-8; save it as UTF-8"]),
    ("[filter]\n".encode("utf-16"), ["is not valid TOML: byte 0xff in line 1 is no UTF-8"]),
    (b"a = " + b"[" * 5000, ["is not valid TOML: it is nested too deeply"]),
    (b"a = 1" + b"0" * 5000, ["is not valid TOML: Exceeds the limit"]),
    (b'"a\\nb\\u001b[31m" = 1\n', [r"'a\nb\x1b[31m': unknown key"]),
    (
        b"[limits]\nlog_behind = 1\nestimate_stale_s = 1e9\n[display]\nstatus_line = 'no'\n",
        ["log_behind: unknown key", "estimate_stale_s: must be <= 600", "status_line: must be true or false"],
    ),
]


@pytest.mark.parametrize(("content", "words"), FAULTS)
def test_each_fault_is_a_sentence_and_nothing_is_written(
    content: bytes, words: list[str], file: Path, here: Here
) -> None:
    file.write_bytes(content)
    before = sorted(here.directory.rglob("*"))
    code, out, said = here.words_of("import", here.recording, here.directory / "out.mcap")
    assert (code, out) == (2, "")
    assert all(word in said for word in words)
    assert len(said.splitlines()) == (1 if "at line" in said or len(words) == 1 else len(words))
    assert all(str(file) in line for line in said.splitlines())
    assert sorted(here.directory.rglob("*")) == before
    assert here.words_of("settings")[0] == 2
    logs = here.directory / "logs"
    assert here.words_of("connect", "127.0.0.1:9", "--open", "--log", logs)[0] == 2
    assert not logs.exists()


def test_a_file_that_is_there_and_cannot_be_read_is_a_fault(file: Path, here: Here) -> None:
    file.mkdir()
    code, _, said = here.words_of("settings")
    assert (code, said) == (2, f"wayfix: {file}: cannot be read (Is a directory); give the path of a readable file\n")
    file.rmdir()
    file.symlink_to("nowhere")
    code, _, said = here.words_of("settings")
    assert code == 2
    assert "cannot be read (No such file" in said


def refusing(method: Callable[..., Any], file: Path) -> Callable[..., Any]:
    """A method of paths that refuses one of them: Python's own modules read files, too."""

    def refused(path: Path, *arguments: Any, **options: Any) -> Any:
        if path == file:
            raise PermissionError(13, "Permission denied")
        return method(path, *arguments, **options)

    return refused


def test_a_place_that_may_not_be_looked_into_is_a_fault(
    file: Path, here: Here, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Root may look everywhere.
    for name in ("lstat", "read_text"):
        monkeypatch.setattr(Path, name, refusing(getattr(Path, name), file))
    code, _, said = here.words_of("settings")
    assert code == 2
    assert f"{file}: cannot be read (Permission denied)" in said


def test_a_file_that_is_named_must_be_there(file: Path, here: Here) -> None:
    code, _, said = here.words_of("settings", "--settings", here.directory / "none.toml")
    assert code == 2
    assert "none.toml: cannot be read (No such file or directory)" in said


@pytest.mark.parametrize("content", [None, b"", b"\xef\xbb\xbf", b"# nothing\r\n", b"[filter]\r\n[display]\r\n"])
def test_no_file_an_empty_one_and_empty_tables_are_the_defaults(content: bytes | None, file: Path) -> None:
    if content is None:
        file.parent.rmdir()
        file.parent.write_bytes(b"no directory")
        assert station_settings(None) == DEFAULTS
        file.parent.unlink()
    else:
        file.write_bytes(content)
    assert station_settings(None) == DEFAULTS


def test_without_a_home_there_are_no_settings_and_no_keys(here: Here, monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CONFIG_HOME")
    monkeypatch.delenv("WAYFIX_KEYS", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    assert station_settings(None) == DEFAULTS
    code, out, _ = here.words_of("settings")
    assert code == 0
    assert "this user has no home directory" in out
    code, _, said = here.words_of("connect", "127.0.0.1:9")
    assert code == 2
    assert "this user has no home directory; set HOME" in said


def test_a_file_of_windows_is_read(file: Path) -> None:
    file.write_bytes(b"\xef\xbb\xbf" + STEPPED.replace(b"\n", b"\r\n"))
    settings = station_settings(None)
    assert (settings.filter.names, settings.filter.step_s) == (("ukf", "fuzzy"), 2.0)
    assert settings.sources == {"filter.names": "wayfix.toml", "filter.step_s": "wayfix.toml"}


def test_the_file_is_used_the_named_one_before_it_and_the_command_line_before_both(file: Path, here: Here) -> None:
    file.write_bytes(STEPPED)
    other = here.directory / "race.toml"
    other.write_bytes(b"[filter]\nnames = ['kf']\n")
    cases = [
        ([], ["ukf", "fuzzy"], 2.0, {"filter.names": "wayfix.toml", "filter.step_s": "wayfix.toml"}),
        (["--step", "0"], ["ukf", "fuzzy"], None, {"filter.names": "wayfix.toml", "filter.step_s": "command line"}),
        (["--filters", "kf"], ["kf"], 2.0, {"filter.names": "command line", "filter.step_s": "wayfix.toml"}),
        (["--settings", str(other)], ["kf"], None, {"filter.names": "race.toml"}),
        (["--settings", str(other), "--filters", "ukf"], ["ukf"], None, {"filter.names": "command line"}),
        (["--settings", os.devnull], ["fuzzy"], None, {}),
        (["--filters", "none"], [], None, {}),
    ]
    for given_options, names, step_s, sources in cases:
        options = options_of(here.import_it(*given_options))
        assert (options["filters"], options["step_s"], options["settings"]) == (names, step_s, {"from": sources})


def test_a_replay_takes_the_filters_and_the_step_of_the_log(file: Path, here: Here) -> None:
    file.write_bytes(STEPPED)
    log = here.import_it()
    assert len({round(each["t_ns"] / 2e9, 6) % 1 for each in estimates_of(log)}) == 1  # two seconds apart: it was used
    file.write_bytes(b"[filter]\nnames = ['kf']\nstep_s = 0.5\n")
    replay = Replay(log)
    replay.run(Watchers())
    assert (replay.filters, replay.step_s) == (("ukf", "fuzzy"), 2.0)
    assert replay.comparison is not None
    assert (replay.comparison.first, replay.comparison.estimates.differs) == (None, False)
    assert replay.comparison.estimates.equal == len(estimates_of(log)) > 20
    again = here.directory / "again.mcap"
    file.write_bytes(b"broken")
    code, out, _ = here.words_of("replay", log, "--record", again)
    assert code == 0
    assert "estimates equal to the recorded ones" in out
    assert [each["digest"] for each in estimates_of(again)] == [each["digest"] for each in estimates_of(log)]
    assert "settings" not in options_of(again)


def test_a_step_of_a_log_can_be_left_out(file: Path, here: Here) -> None:
    file.write_bytes(STEPPED)
    log = here.import_it()
    replay = Replay(log, step_s=0.0)
    replay.run(Watchers())
    assert (replay.step_s, replay.why_not) == (None, "the step is another")
    file.unlink()
    freely = here.import_it("--filters", "ukf,fuzzy")
    assert replay.estimates == len(estimates_of(freely))


def test_a_replay_reads_settings_for_what_it_shows_and_only_then(file: Path, here: Here) -> None:
    log = here.import_it()
    code, _, said = here.words_of("replay", log, "--settings", os.devnull)
    assert code == 2
    assert "--settings needs --speed" in said
    file.write_bytes(b"[display]\nevents_from = 'error'\nstatus_line = false\n")
    assert "filters start at" not in here.words_of("replay", log, "--speed", 1000)[2]
    assert "filters start at" in here.words_of("replay", log, "--speed", 1000, "--settings", os.devnull)[2]
    file.write_bytes(b"[display]\nevents = 'error'\n")
    new = here.directory / "new.mcap"
    assert here.words_of("replay", log, "--speed", 1000, "--record", new)[0] == 2
    assert not new.exists()


def test_wayfix_settings_prints_a_file_with_sources(file: Path, here: Here) -> None:
    file.write_bytes(b"[limits]\nlink_lost_s = 9\n[display]\nstatus_line = false\n")
    code, out, said = here.words_of("settings", "--filters", "kf,ukf")
    assert (code, said) == (0, "")
    assert out.startswith(f"# {file}\n")
    assert 'names = ["kf", "ukf"]  # command line' in out
    assert "link_lost_s = 9.0  # wayfix.toml" in out
    assert "log_behind_s = 5.0  # default" in out
    printed = here.directory / "printed.toml"
    printed.write_text(out)
    assert replaced(station_settings(printed)) == replaced(station_settings(None, "kf,ukf"))
    answer = json.loads(here.words_of("settings", "--json")[1].splitlines()[-1])
    assert answer["settings"]["from"] == {"limits.link_lost_s": "wayfix.toml", "display.status_line": "wayfix.toml"}
    assert answer["file"] == str(file)


def test_a_name_that_is_no_text_does_no_harm_to_the_log(here: Here) -> None:
    odd = here.directory / "\udcff\x1b.toml"
    odd.write_bytes(STEPPED)
    log = here.import_it("--settings", str(odd))
    assert options_of(log)["settings"]["from"]["filter.names"] == r"\udcff\x1b.toml"
    assert here.words_of("replay", log)[0] == 0


def test_log_info_shows_what_was_set(file: Path, here: Here) -> None:
    log = here.import_it()
    assert "wayfix.toml" not in here.words_of("log", "info", log)[1]
    file.write_bytes(STEPPED)
    log = here.import_it("--filters", "kf")
    assert "filter.names kf (command line), filter.step_s 2.0 (wayfix.toml)" in " ".join(
        here.words_of("log", "info", log)[1].split()
    )


def replaced(settings: StationSettings) -> tuple[Any, ...]:
    """The settings without their sources."""
    return tuple(getattr(settings, table) for table in TABLES)


@given(
    st.builds(
        LimitSettings,
        link_lost_s=st.floats(1.5, 60.0),
        log_behind_s=st.floats(1.0, 600.0),
        estimate_stale_s=st.floats(0.1, 600.0),
    ),
    st.builds(DisplaySettings, status_line=st.booleans(), events_from=st.sampled_from(LEVELS)),
)
def test_what_is_printed_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, limits: LimitSettings, display: DisplaySettings
) -> None:
    path = tmp_path_factory.mktemp("settings", numbered=True) / "wayfix.toml"
    settings = StationSettings(limits=limits, display=display)
    path.write_text("\n".join(lines_of(settings)))
    assert replaced(station_settings(path)) == replaced(settings)


def test_the_example_and_the_page_name_every_key_with_its_default() -> None:
    example = REPOSITORY / "deploy" / "examples" / "wayfix.toml"
    assert replaced(station_settings(example)) == replaced(DEFAULTS)
    keys = {f"{table}.{field.name}" for table in TABLES for field in fields(getattr(DEFAULTS, table))}
    assert keys - set(station_settings(example).sources) == {"filter.step_s"}
    page = (REPOSITORY / "docs" / "settings.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+\.\w+)` \| (\S+) \|", page, flags=re.MULTILINE))
    assert set(rows) == keys
    for key, shown in rows.items():
        table, _, name = key.partition(".")
        default = as_dict(getattr(DEFAULTS, table)).get(name)
        written = None if shown == "none" else tomllib.loads(f"a = {shown.strip('`')}")["a"]
        assert written == default, key
