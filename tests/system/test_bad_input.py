"""Wrong input and wrong environment: one sentence that says what and how to cure it, exit code 2, no traceback."""

import os
import pty
import re
import socket
import subprocess
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.harness import BIN, Process, command, compass_config


@pytest.fixture
def serial_port() -> Iterator[str]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)


def write_config(directory: Path, path: str = "/dev/none", bind: str = "tcp://127.0.0.1:*") -> Path:
    return compass_config(directory, bind, p=path)


def refused(*arguments: str | Path) -> str:
    done = command(*arguments, seconds=20)
    assert done.returncode == 2, (done.returncode, done.stderr)
    assert "Traceback" not in done.stderr
    lines = done.stderr.strip().splitlines()
    sentence = lines[-1]
    assert sentence.startswith(f"{arguments[0]}: ") or "error: " in sentence  # argparse' own form
    return sentence


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["wayfix", "connect", "--open", "not an address"], "not an address; give HOST or HOST:PORT"),
        (["wayfix", "connect", "--open", "127.0.0.1:99999"], "give HOST or HOST:PORT"),
        (["wayfix", "connect", "--open", "127.0.0.1:1"], "no answer within 5 s; check the address, the Wi-Fi"),
        (
            ["wayfix", "connect", "--open", "127.0.0.1", "--filters", "kalmann"],
            "unknown filter 'kalmann'; use one or more of",
        ),
        (
            ["wayfix", "connect", "--open", "127.0.0.1", "--frames", "0"],
            "must be a whole number from 1 to 10000000, got '0'",
        ),
        (
            ["wayfix", "connect", "--open", "127.0.0.1", "--frames", "ten"],
            "must be a whole number from 1 to 10000000, got 'ten'",
        ),
        (["wayfix", "connect", "--open", "127.0.0.1", "--step", "-1"], "must be a number from 0.05 to 60.0, got '-1'"),
        (["wayfix", "connect", "--open", "127.0.0.1", "--period", "2"], "--period needs --frames"),
        (["wayfix", "replay", "/dev/none.mcap"], "/dev/none.mcap: cannot be read"),
        (["wayfix", "demo", "--scenario", "9.9"], "wayfix: --scenario: there is no scenario '9.9'"),
        (["wayfix", "demo", "--boat", "/dev/none.toml"], "wayfix: /dev/none.toml: cannot be read"),
        (["wayfix", "demo", "--boat", "a.toml", "--recording", "a.csv", "--map", "a.toml"], "belongs to a scenario"),
        (["wayfix", "demo", "--recording", "a.csv"], "--recording and --map go together"),
        (["wayfix", "demo", "--recording", "/dev/none.csv", "--map", "/dev/none.toml"], "/dev/none"),
        (["wayfix", "demo", "--speed", "0"], "must be a number from 0.1 to 100.0, got '0'"),
        (["wayfix-onboard", "run", "--open", "/dev/none.toml"], "/dev/none.toml: cannot be read"),
        (["wayfix-onboard", "virtual", "--scenario", "x"], "x"),
        (["wayfix-onboard", "check", "/dev/none.toml"], "cannot be read"),
    ],
)
def test_wrong_arguments(arguments: list[str], part: str) -> None:
    assert part in refused(*arguments)


def test_a_replay_of_something_else_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.mcap"
    file.write_bytes(b"")
    assert "the file is empty" in refused("wayfix", "replay", file)
    file.write_bytes(b"\x89MCAP0\r\n")
    assert "the log was not closed" in refused("wayfix", "replay", file)
    file.write_text("$GPGGA,...\n", encoding="ascii")
    assert "not an MCAP log" in refused("wayfix", "replay", file)


def test_a_broken_configuration_names_every_key(tmp_path: Path) -> None:
    file = write_config(tmp_path)
    file.write_text(file.read_text() + "rate_hz = -1\nsigma = 3\n", encoding="utf-8")
    done = command("wayfix-onboard", "run", "--open", file)
    assert done.returncode == 2
    assert "compass1.rate_hz: must be >= 0.01, got -1" in done.stderr
    assert "compass1.sigma: unknown key, did you mean sigma_m?" in done.stderr
    assert "Traceback" not in done.stderr


def test_check_names_a_missing_a_busy_and_a_wrong_port(tmp_path: Path, serial_port: str) -> None:
    assert "p (/dev/none): no such device" in refused("wayfix-onboard", "check", write_config(tmp_path))
    config = write_config(tmp_path, serial_port)
    assert command("wayfix-onboard", "check", config, "--listen", "0").returncode == 0
    silent = command("wayfix-onboard", "check", config, "--listen", "0.3")
    assert silent.returncode == 1
    assert "compass1 does not deliver: nothing received yet" in silent.stdout
    holder = Process("wayfix-onboard", "run", "--open", write_config(tmp_path, serial_port))
    try:
        holder.ready()
        assert re.search(
            r"busy; wayfix-onboard \(pid \d+\) holds it", refused("wayfix-onboard", "check", config, "--listen", "0")
        )
    finally:
        holder.end()
    plain = tmp_path / "plain.txt"
    plain.write_text("", encoding="ascii")
    assert "not a serial port" in refused("wayfix-onboard", "check", write_config(tmp_path, str(plain)))


def test_the_daemon_lives_on_without_a_port_and_says_so_once(tmp_path: Path) -> None:
    daemon = Process("wayfix-onboard", "run", "--open", write_config(tmp_path))
    try:
        address = daemon.ready()["bind"]
        done = command("wayfix", "connect", "--open", address, "--no-log", "--frames", "2", "--period", "0.1")
        assert done.returncode == 0
        assert "compass1 missing: no such device" in done.stderr
        assert sum("cannot be opened: no such device" in line for line in daemon.err) == 1
    finally:
        daemon.end()


def test_a_socket_in_use_is_one_sentence(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        file = write_config(tmp_path, bind=f"tcp://127.0.0.1:{port}")
        assert "cannot listen there (Address already in use)" in refused("wayfix-onboard", "run", "--open", file)
    for verb in ("run", "check"):
        file = write_config(tmp_path, bind="nonsense")
        assert "link.bind: must be tcp://ADDRESS:PORT" in refused("wayfix-onboard", verb, file)
        file = write_config(tmp_path, bind="tcp://*:99999")  # libzmq would take what is left of it, 34463
        assert "link.bind: there is no port above 65535" in refused("wayfix-onboard", verb, file)
    file = write_config(tmp_path)
    assert "--bind: there is no port" in refused("wayfix-onboard", "run", "--open", file, "--bind", "tcp://*:99999")


@pytest.mark.parametrize("is_damaged", [True, False])
def test_a_start_counter_that_cannot_be_kept_is_a_warning_and_the_boat_sails(tmp_path: Path, is_damaged: bool) -> None:
    file = write_config(tmp_path)
    state = tmp_path / "state"
    if is_damaged:
        state.mkdir()
        (state / "start_no").write_text("", encoding="ascii")
    else:
        state.write_text("", encoding="ascii")  # no directory, and none can be made there
    daemon = Process("wayfix-onboard", "run", "--open", file, "--state", state)
    try:
        daemon.ready()
        daemon.wait_for_words("is empty: this is start 1" if is_damaged else "the start counter cannot be kept")
    finally:
        daemon.end()
    if is_damaged:
        assert (state / "start_no").read_text(encoding="ascii") == "1\n"


def test_a_log_directory_that_cannot_be_written(tmp_path: Path) -> None:
    file = write_config(tmp_path)
    daemon = Process("wayfix-onboard", "run", "--open", file)
    try:
        address = daemon.ready()["bind"]
        assert "no log can be written here" in refused("wayfix", "connect", "--open", address, "--log", file / "log")
        assert "cannot be used" in refused("wayfix", "demo", "--log", file / "log")
    finally:
        daemon.end()


def test_a_fast_clock_is_for_pseudo_terminals_only(tmp_path: Path) -> None:
    sentence = refused("wayfix-onboard", "run", "--open", write_config(tmp_path, "/dev/ttyS0"), "--clock-rate", "4")
    assert "--clock-rate needs pseudo-terminals only" in sentence


def test_a_bounded_run_that_the_board_refuses(tmp_path: Path) -> None:
    daemon = Process("wayfix-onboard", "run", "--open", write_config(tmp_path))
    try:
        address = daemon.ready()["bind"]
        sentence = refused("wayfix", "connect", "--open", address, "--frames", "2", "--period", "0.25")
        assert "period_s must be a multiple of the board's frame period, 0.1 s" in sentence
    finally:
        daemon.end()


def test_a_reader_that_has_had_enough_is_no_fault(tmp_path: Path) -> None:
    play = f"'{BIN}/wayfix-onboard' virtual --seconds 5 --exit-at-end --dir '{tmp_path}/boat'"
    done = subprocess.run(
        ["bash", "-c", f"{play} | head -1; exit ${{PIPESTATUS[0]}}"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("program", ["wayfix", "wayfix-onboard"])
def test_help_lists_every_command(program: str) -> None:
    done = command(program, "--help")
    expected = {"wayfix": ("connect", "replay", "demo"), "wayfix-onboard": ("run", "check", "virtual")}[program]
    assert done.returncode == 0
    assert all(word in done.stdout for word in expected)
