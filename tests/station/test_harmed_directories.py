"""Random lives of a log directory (model-based test): power cuts, removals, harmed and older cursors, reboots."""

import random
import shutil
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pytest

from common.messages import Frame
from shore.live.earlier_trips import complete_trips
from shore.replay.run import Replay
from tests.station.journeys import Board, session
from tests.station.logs import UTC_NS
from tests.station.test_cursor import HARM
from tests.station.test_journey import check_each_frame_once, copied


class Life:
    """A directory of logs and what happens to it and to its board."""

    def __init__(self, draw: random.Random, place: Path, voyage: list[Frame]) -> None:
        self.draw, self.place = draw, place
        self.board = Board(voyage)
        self.board.has_sensors = draw.random() < 0.5
        self.directory = place / "logs"
        self.cursors: list[bytes] = []
        self.cuts = 0
        self.session()

    def session(self) -> None:
        session(self.directory, self.board, self.draw.choice([0.5, 1.5]), fill=self.draw.choice([0, 1, 3, 50]))

    def power_cut(self) -> None:
        """The directory as it was at some moment of a session."""
        self.cuts += 1
        cut, looks = self.place / f"cut{self.cuts}", iter(range(self.draw.randrange(1, 25)))

        def look() -> None:
            if next(looks, None) is None and not cut.exists():
                shutil.copytree(self.directory, cut, copy_function=copied)

        session(self.directory, self.board, 2.0, fill=self.draw.choice([0, 2, 30]), look=look)
        self.directory = cut if cut.exists() else self.directory

    def logs_are_removed_meanwhile(self) -> None:
        at = {self.board.count + 5}

        def look() -> None:
            if self.board.count in at:
                at.clear()
                for log in self.directory.glob("*.mcap"):
                    log.unlink()

        session(self.directory, self.board, 3.0, fill=self.draw.choice([0, 5]), look=look)

    def newest_log_is_removed(self) -> None:
        logs = sorted(self.directory.glob("*.mcap"))
        if len(logs) > 1:
            logs[-1].unlink()

    def cursor_is_harmed(self) -> None:
        if self.cursor.exists():
            self.cursor.write_bytes(self.draw.choice([*HARM.values()])(self.cursors[0]))

    def cursor_is_kept(self) -> None:
        if self.cursor.exists():
            self.cursors.append(self.cursor.read_bytes())

    def cursor_is_of_a_backup(self) -> None:
        if self.cursors:
            self.cursor.write_bytes(self.draw.choice(self.cursors))

    def cursor_is_removed(self) -> None:
        self.cursor.unlink(missing_ok=True)

    def board_reboots(self) -> None:
        self.board.reboot(self.draw.randrange(20))

    def daemon_restarts(self) -> None:
        self.board.restart(self.draw.randrange(20))

    def board_sails_alone(self) -> None:
        self.board.make(self.draw.randrange(1, 40))

    def late_frames_are_put_into_trips(self) -> None:
        complete_trips(self.directory, print)

    @property
    def cursor(self) -> Path:
        return self.directory / "springer.cursor"


HAPPENINGS = [
    Life.session, Life.power_cut, Life.logs_are_removed_meanwhile, Life.newest_log_is_removed, Life.cursor_is_harmed,
    Life.cursor_is_kept, Life.cursor_is_of_a_backup, Life.cursor_is_removed, Life.board_reboots, Life.daemon_restarts,
    Life.board_sails_alone, Life.late_frames_are_put_into_trips,
]  # fmt: skip


@pytest.mark.parametrize("seed", [0, 1060, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 40))])
def test_each_frame_that_the_board_holds_is_in_one_log_in_its_order(
    seed: int, tmp_path: Path, voyage: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    seconds = count(UTC_NS, 10**9)
    monkeypatch.setattr("shore.logbook.background_writer.time", SimpleNamespace(time_ns=lambda: next(seconds)))
    draw = random.Random(seed)
    life = Life(draw, tmp_path, voyage)
    life.cursor_is_kept()
    happened = [draw.choice(HAPPENINGS) for _ in range(draw.randrange(3, 10))]
    print(*(each.__name__ for each in happened))
    for each in happened:
        each(life)
    for _ in range(2):
        session(life.directory, life.board, 2.0, fill=3000)
        complete_trips(life.directory, print)
    check_each_frame_once(life.directory, life.board)
    for log in life.directory.glob("*.mcap"):
        order = [step.frame.boot_id for step in Replay(log, order="time")]
        assert order == sorted(order), log
