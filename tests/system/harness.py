"""Real processes for the system tests: virtual boat, daemon, station, each told apart by its output."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

BIN = Path(sys.executable).parent


def compass_config(directory: Path, bind: str = "tcp://127.0.0.1:*", **paths: str) -> Path:
    """A board with one compass on each port given as name=path; compass1 on the first."""
    text = f'[boat]\nid = "b"\n[link]\nbind = "{bind}"\n'
    for name, path in paths.items():
        text += f'[[port]]\nname = "{name}"\npath = "{path}"\nbyte_budget_per_s = 2000\n'
    for number, name in enumerate(paths, 1):
        text += f'[[sensor]]\nid = "compass{number}"\nport = "{name}"\nrole = "compass"\n'
    file = directory / "boat.toml"
    file.write_text(text, encoding="utf-8")
    return file


class Process:
    """A command of ours; stdout lines that are JSON objects and all stderr lines are kept."""

    def __init__(self, *arguments: str | Path, inside: Sequence[str] = ()) -> None:
        """inside: what is to run it, as `ip netns exec NAME`."""
        command = [*inside, str(BIN / str(arguments[0])), *map(str, arguments[1:])]
        self.popen = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.json: list[dict[str, Any]] = []
        self.out: list[str] = []
        self.err: list[str] = []
        self._threads = [
            threading.Thread(target=self._read, args=(self.popen.stdout, self.out), daemon=True),
            threading.Thread(target=self._read, args=(self.popen.stderr, self.err), daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    def _read(self, stream: Any, lines: list[str]) -> None:
        for line in stream:
            lines.append(line.rstrip("\n"))
            if stream is self.popen.stdout and line.startswith("{"):
                self.json.append(json.loads(line))

    def said(self, key: str) -> dict[str, Any] | None:
        return next((line[key] for line in self.json if key in line), None)

    def wait_for(self, what: Callable[["Process"], Any], seconds: float = 15.0) -> Any:
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            if found := what(self):
                return found
            if self.popen.poll() is not None:
                break
            time.sleep(0.02)
        if found := what(self):
            return found
        raise AssertionError(f"not seen; exit code {self.popen.poll()}\nout: {self.out}\nerr: {self.err}")

    def ready(self) -> dict[str, Any]:
        return dict(self.wait_for(lambda me: me.said("ready")))

    def wait_for_words(self, words: str, seconds: float = 15.0) -> str:
        return str(self.wait_for(lambda me: next((line for line in me.err if words in line), None), seconds))

    def tell(self, line: str) -> None:
        assert self.popen.stdin is not None
        self.popen.stdin.write(line + "\n")
        self.popen.stdin.flush()

    def send(self, number: signal.Signals) -> None:
        os.kill(self.popen.pid, number)

    def finish(self, seconds: float = 15.0) -> int:
        code = self.popen.wait(seconds)
        for thread in self._threads:
            thread.join(2)
        for stream in (self.popen.stdin, self.popen.stdout, self.popen.stderr):
            if stream is not None:
                with suppress(BrokenPipeError):
                    stream.close()
        return code

    def end(self) -> None:
        if self.popen.poll() is None:
            self.popen.kill()
        self.finish()


class Boat:
    """A virtual boat and a daemon on it, already running."""

    def __init__(self, virtual: Process, daemon: Process, ready: dict[str, Any]) -> None:
        self.virtual = virtual
        self.daemon = daemon
        self.files = ready
        self.address = daemon.said("ready")["bind"]  # type: ignore[index]

    @contextmanager
    def restarted(self, config: str | Path) -> Iterator[Process]:
        """The daemon once more on the same address, after it was killed."""
        clock = self.daemon.popen.args[4:]  # type: ignore[index]
        second = Process("wayfix-onboard", "run", "--open", config, "--bind", self.address, *clock)
        try:
            second.ready()
            yield second
        finally:
            second.end()


@contextmanager
def station(address: str, *arguments: str | Path) -> Iterator[Process]:
    """`wayfix connect`; ended in any case."""
    process = Process("wayfix", "connect", "--open", address, *arguments)
    try:
        yield process
    finally:
        process.end()


@contextmanager
def boat(directory: Path, *, speed: float = 4.0, seconds: float = 600.0) -> Iterator[Boat]:
    """Virtual boat and daemon at `speed`; ended in any case."""
    start = str(time.clock_gettime_ns(time.CLOCK_BOOTTIME))
    clock = ("--clock-rate", f"{speed:g}", "--clock-start", start)
    place = ("--dir", directory / "boat", "--bind", "tcp://127.0.0.1:*")
    processes: list[Process] = []
    try:
        length = ("--seconds", f"{seconds:g}", "--until-stdin-closes")
        virtual = Process("wayfix-onboard", "virtual", "--scenario", "5.3", *length, *place, *clock)
        processes.append(virtual)
        ready = virtual.ready()
        daemon = Process("wayfix-onboard", "run", "--open", ready["config"], *clock)
        processes.append(daemon)
        daemon.ready()
        yield Boat(virtual, daemon, ready)
    finally:
        # The daemon first: behind a killed boat's ports it might find another program's terminals.
        for process in reversed(processes):
            process.end()


def command(*arguments: str | Path, seconds: float = 60.0, stdin: str = "") -> subprocess.CompletedProcess[str]:
    """Run one of our commands to its end."""
    line = [str(BIN / str(arguments[0])), *map(str, arguments[1:])]
    return subprocess.run(line, input=stdin, capture_output=True, text=True, timeout=seconds, check=False)
