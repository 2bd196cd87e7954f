"""`wayfix demo`: a whole boat on this machine. Virtual boat and daemon are real processes, the station is the real one.

    virtual boat --ptys--> daemon --socket--> station --> log, table, picture

Order of the end: the virtual boat has sent everything, the daemon is asked to stop, drains and sends `end`, the station
closes its log, then the virtual boat goes.
"""

import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from common.clock import BoatClock, boottime_ns
from common.codec import decode_frame
from common.errors import LinkError, WayfixError
from common.key_list import Entry, with_entry
from common.keys import new_keys, write_own
from common.link_messages import MAX_WINDOW
from common.units import NS_PER_S
from common.words import how_to_install
from shore.link.link import Link
from shore.link.transport import LinkKeys
from shore.live.run import LiveRun, Options
from shore.live.stop_flag import StopFlag
from shore.live.tally import Tally
from shore.logbook.log_reader import read_log
from shore.replay.frames import logged_config
from shore.report.score import score_of
from shore.settings.station import FilterSettings, StationSettings

READY_S: Final = 20.0
DRAIN_BOAT_S: Final = 1.0
"""Boat time between the virtual boat's last byte and the daemon's stop, s: the last GPS epoch closes in it."""
BEHIND_S: Final = 1.0
"""Age of the newest frame that a station may have when the daemon is stopped, s: it takes the last one in time."""
CATCH_UP_S: Final = 60.0
"""Time that a station may take for what it is behind when the mission is over, s; on a slow machine that is a lot."""
END_S: Final = 20.0
"""Time that the daemon's last messages may take, s, also for a station on a slow disk; half a second is usual."""
STOP_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class DemoOptions:
    """What to play; `seconds` None = the whole mission."""

    scenario: str
    seed: int
    speed: float
    seconds: float | None
    filters: tuple[str, ...]
    log_dir: Path | None
    boat: Path | None = None
    """File of the boat that sails; `None` = receiver, compass and IMU."""
    recording: Path | None = None
    mapping: Path | None = None
    headless: bool = False


class Stopped(Exception):  # noqa: N818 (no error: the person asked for it)
    """Ctrl-C or SIGTERM before there was anything to show."""


class Child:
    """A process of the demo; its stdout is JSON lines, its stderr is kept for the case that it dies."""

    def __init__(self, name: str, arguments: list[str]) -> None:
        # A script beside the interpreter: found also when the virtual environment is not activated.
        program = Path(sys.executable).with_name("wayfix-onboard")
        if not program.exists():
            raise WayfixError(
                "wayfix-onboard is not installed here", str(program.parent), how_to_install("onboard,shore")
            )
        self.name = name
        self.last_lines: deque[str] = deque(maxlen=5)
        self._lines: queue.Queue[dict[str, Any]] = queue.Queue()
        self.process = subprocess.Popen(  # noqa: S603 (our own program, no shell)
            [str(program), *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is the demo's to pass on, in order
        )
        threading.Thread(target=self._read_stdout, daemon=True).start()
        threading.Thread(target=self._read_stderr, daemon=True).start()

    def expect(self, key: str, timeout_s: float, stopped: Callable[[], bool]) -> dict[str, Any]:
        """Wait for the JSON line {key: ...}; raises WayfixError when the child dies or keeps silent."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline and not stopped():
            if (line := self.said(key)) is not None:
                return line
            if self.process.poll() is not None:
                raise self.death()
            time.sleep(0.02)
        if stopped():
            raise Stopped
        last = self.last_lines[-1] if self.last_lines else "it said nothing"
        raise WayfixError(f"{self.name} did not get ready within {timeout_s:g} s: {last}", cure="try a lower --speed")

    def said(self, key: str) -> dict[str, Any] | None:
        """The value of the next JSON line with this key, if it has come; other lines are dropped."""
        while True:
            try:
                line = self._lines.get_nowait()
            except queue.Empty:
                return None
            if key in line:
                return dict(line[key])

    def tell(self, line: str) -> None:
        """Write one line to the child's stdin."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(line + "\n")
            self.process.stdin.flush()
        except OSError as error:
            raise self.death() from error

    def death(self) -> WayfixError:
        """The sentence for a child that has ended; one that refuses its arguments has said it itself."""
        time.sleep(0.1)  # its last line may still be on the way
        code = self.process.poll()
        if code == 2 and self.last_lines:
            return WayfixError(self.last_lines[-1].removeprefix("wayfix-onboard: "))
        how = f"killed by {signal.Signals(-code).name}" if code is not None and code < 0 else f"exit code {code}"
        last = self.last_lines[-1] if self.last_lines else "it said nothing"
        return WayfixError(f"{self.name} ended unexpectedly ({how}): {last}", cure="the demo stops")

    def terminate(self) -> None:
        """SIGTERM, and SIGKILL for one that does not listen."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()

    def _read_stdout(self) -> None:
        assert self.process.stdout is not None
        for text in self.process.stdout:
            try:
                line = json.loads(text)
            except ValueError:
                continue
            if isinstance(line, dict):
                self._lines.put(line)

    def _read_stderr(self) -> None:
        assert self.process.stderr is not None
        for text in self.process.stderr:
            self.last_lines.append(text.rstrip())


class Demo:
    """Runs the processes and the station; `say` prints for the person at the terminal."""

    def __init__(self, options: DemoOptions, say: Callable[[str], None]) -> None:
        self.options = options
        self._say = say
        self._stop = StopFlag()
        self._virtual: Child | None = None
        self._daemon: Child | None = None
        self._live_run: LiveRun | None = None
        self._clock = BoatClock(options.speed, boottime_ns())
        self._done_ns: int | None = None
        self._asked_to_end_ns: int | None = None
        self._behind_s = 0.0
        """Age of the newest frame of the station when the mission was over, real s."""
        self.dead: WayfixError | None = None

    def run(self) -> dict[str, Any] | None:
        """The whole demo; returns the JSON summary, without figures after Ctrl-C, None when that came before any frame.

        Raises WayfixError when a child dies, nothing can start, or the daemon does not end its session.
        """
        directory = self._directory()
        with self._stop.on_signals():
            try:
                ready, link = self._start(directory)
                tally, log_path = self._live(link, directory)
            except (Stopped, LinkError):
                if self._stop():
                    return None
                raise
            finally:
                for child in (self._daemon, self._virtual):
                    if child is not None:
                        child.terminate()
        if self.dead is not None:
            raise self.dead
        counts = {"sent": tally.sent, "received": tally.received, "lost": tally.missing + tally.lost}
        if self._stop():
            return {"frames": counts, "log": str(log_path)}
        if tally.sent is None:
            behind = f"the daemon did not end its session; the station was {self._behind_s:.1f} s behind it"
            raise WayfixError(behind, cure="try a lower --speed, the machine may be too slow")
        return self._summary(counts, log_path, Path(ready["truth"]))

    def _directory(self) -> Path:
        if self.options.log_dir is None:
            return Path(tempfile.mkdtemp(prefix="wayfix-demo-"))
        try:
            self.options.log_dir.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            cure = "give a directory that can be written"
            raise WayfixError(f"cannot be used ({error.strerror})", str(self.options.log_dir), cure) from error
        return self.options.log_dir

    def _start(self, directory: Path) -> tuple[dict[str, Any], Link]:
        clock = ["--clock-rate", f"{self.options.speed:g}", "--clock-start", str(self._clock.t_start_ns)]
        clock.append("--until-stdin-closes")
        source = ["--scenario", self.options.scenario]
        if self.options.boat is not None:
            source += ["--boat", str(self.options.boat)]
        if self.options.recording is not None:
            source = ["--recording", str(self.options.recording), "--map", str(self.options.mapping)]
        length = [] if self.options.seconds is None else ["--seconds", f"{self.options.seconds:g}"]
        self._say("starting the virtual boat and the daemon ...")
        place = [
            "--dir",
            str(_new_directory(directory)),
            "--bind",
            "tcp://127.0.0.1:*",
            "--seed",
            str(self.options.seed),
        ]
        self._virtual = Child("virtual boat", ["virtual", *source, *length, *place, *clock, "--hold"])
        ready = self._virtual.expect("ready", READY_S, self._stop)
        for warning in self._virtual.last_lines:
            self._say(warning)
        state, keys = Path(ready["config"]).with_name("state"), new_keys()
        _allow(state, keys.public)
        self._daemon = Child("daemon", ["run", ready["config"], "--state", str(state), *clock])
        daemon = self._daemon.expect("ready", READY_S, self._stop)
        boat = LinkKeys(keys.public, keys.secret, daemon["public_key"].encode("ascii"))
        return ready, Link(daemon["bind"], client="demo", keys=boat, window=MAX_WINDOW)

    def _live(self, link: Link, directory: Path) -> tuple[Tally, Path]:
        assert self._virtual is not None
        try:
            # The same on every machine: a demo reads no wayfix.toml.
            settings = StationSettings(FilterSettings(self.options.filters))
            options = Options(settings, log_dir=directory, until_end=True)
            say = (lambda _line: None) if self.options.headless else self._say
            live = self._live_run = LiveRun(link, options, self._supervise, say)
            with suppress(WayfixError):  # a child that is dead by now is found by `_supervise`; the log is closed
                self._virtual.tell("go")
            tally = live.run()
            if live.log_fault is not None:
                raise live.log_fault
            assert live.log_path is not None
            return tally, live.log_path
        finally:
            link.close()

    def _supervise(self) -> bool:
        """True when the run should end: a child died, the mission is over, or the person pressed Ctrl-C."""
        assert self._virtual is not None
        assert self._daemon is not None
        if self._stop():
            return True
        now_ns = boottime_ns()
        if self._asked_to_end_ns is not None:
            return now_ns - self._asked_to_end_ns > END_S * 1e9
        for child in (self._virtual, self._daemon):
            if child.process.poll() is not None:
                self.dead = child.death()
                return True
        if self._done_ns is None and self._virtual.said("done") is not None:
            self._done_ns = now_ns
        if self._done_ns is not None and self._is_complete(now_ns - self._done_ns):
            self._asked_to_end_ns = now_ns
            os.kill(self._daemon.process.pid, signal.SIGTERM)
        return False

    def _is_complete(self, since_done_ns: int) -> bool:
        """Whether the station has taken what the mission gave: a daemon that stops waits a second for no station."""
        if since_done_ns <= DRAIN_BOAT_S / self.options.speed * NS_PER_S:
            return False
        assert self._live_run is not None
        self._behind_s = (self._clock.now_ns() - self._live_run.t_ns) / NS_PER_S / self.options.speed
        has_all = self._behind_s < BEHIND_S and self._live_run.missing_count == 0
        return has_all or since_done_ns > CATCH_UP_S * NS_PER_S

    def _summary(self, counts: dict[str, Any], log_path: Path, truth: Path) -> dict[str, Any]:
        reader = read_log(log_path)
        frames = [decode_frame(data) for data in reader.frames()]
        estimates = list(reader.estimates())
        if not frames:
            raise WayfixError("the run gave no frame", str(log_path), "run it longer")
        score = score_of(truth, logged_config(reader, log_path), frames, estimates)
        summary = {"frames": counts, **score.summary(), "log": str(log_path)}
        picture = log_path.with_suffix(".png")
        title = f"Wayfix demo: scenario {self.options.scenario}, seed {self.options.seed}"
        if self.options.recording is not None:
            title = f"Wayfix demo: {self.options.recording.name}"
        try:
            from shore.report.run_picture import draw

            draw(picture, score, frames, estimates, title)
            summary["picture"] = str(picture)
        except ImportError:
            self._say(f"no picture: matplotlib is missing; {how_to_install('report')}")
        except OSError as error:
            self._say(f"no picture: {picture} cannot be written ({error.strerror})")
        return summary


def _allow(state: Path, public_key: bytes) -> None:
    """Put the demo's station on the list of the demo's board before the start."""
    state.mkdir(mode=0o700)
    entry = Entry(public_key.decode("ascii"), "read", "demo")
    write_own(state / "allowed-keys", with_entry("", entry).encode("ascii"))


def _new_directory(parent: Path) -> Path:
    """`boat`, `boat-2`, ...: the truth of an earlier run in the same place stays with its log."""
    number = 1
    while True:
        directory = parent / ("boat" if number == 1 else f"boat-{number}")
        try:
            directory.mkdir()
        except FileExistsError:
            number += 1
            continue
        except OSError as error:
            cure = "give a directory that can be written"
            raise WayfixError(f"cannot be used ({error.strerror})", str(parent), cure) from error
        return directory
