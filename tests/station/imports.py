"""Imports as tests run them: in this process, the summary and the log at hand."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from common.codec import decode_frame
from common.messages import Attitude, Fix, Frame, Heading, TurnRate
from common.units import NS_PER_S
from shore.imports.arguments import add_arguments
from shore.imports.command import run
from shore.logbook.log_reader import read_log

T0 = 1_700_000_000 * NS_PER_S
ISO = "2023-11-14T22:13:20.000Z"

MAP = """
[boat]
id = "b"
[time]
column = "t"
unix = true
[fix]
lat = "lat"
lon = "lon"
sog = "v"
sog_scale = 2.0
[heading]
column = "psi"
scale = -1.0
offset_deg = 90.0
[imu]
yaw_rate = "r"
yaw_rate_scale = -10.0
"""


def iso(second: float) -> str:
    return f"2023-11-14T22:13:{20 + second:06.3f}Z"


def delta(second: float, source: str, **more: Any) -> str:
    values = [{"path": f"navigation.{path}", "value": value} for path, value in more.items()]
    update = {"$source": source, "timestamp": iso(second), "values": values}
    return json.dumps({"context": "vessels.self", "updates": [update]})


def sealed(text: str) -> str:
    total = 0
    for letter in text[1:-1]:
        total ^= ord(letter)
    return f"{text}{total:02X}"


def tpv(second: float | None, **more: Any) -> str:
    time = {} if second is None else {"time": iso(second)}
    return json.dumps({"class": "TPV", "device": "/dev/gps", "mode": 3, **time, **more})


@dataclass
class Imported:
    """One import that did not raise."""

    code: int
    summary: dict[str, Any]
    out: Path
    words: str
    """What was said on stderr."""

    @property
    def frames(self) -> list[Frame]:
        return [decode_frame(record.data) for record in read_log(self.out).records("/frames")]

    @property
    def fixes(self) -> list[Fix]:
        return [fix for frame in self.frames for fix in frame.fixes]

    @property
    def headings(self) -> list[Heading]:
        return [heading for frame in self.frames for heading in frame.headings]

    @property
    def turn_rates(self) -> list[TurnRate]:
        return [rate for frame in self.frames for rate in frame.turn_rates]

    @property
    def attitudes(self) -> list[Attitude]:
        return [attitude for frame in self.frames for attitude in frame.attitudes]

    @property
    def session(self) -> list[dict[str, Any]]:
        return [record.json() for record in read_log(self.out).records("/session")]

    def account(self, unit: str) -> dict[str, Any]:
        found: dict[str, Any] = self.summary["accounts"][unit]
        return found


class Importer:
    """`wayfix import` with its words caught."""

    def __init__(self, directory: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.directory = directory
        self._capsys = capsys

    def __call__(self, source: Path, *options: str, out: str = "out.mcap", filters: str = "none") -> Imported:
        """Raises WayfixError as the command does."""
        return self.together([source], *options, out=out, filters=filters)

    def together(
        self, sources: Sequence[Path | str], *options: str, out: str = "out.mcap", filters: str = "none"
    ) -> Imported:
        """Several recordings, each a path or FILE:MAP.toml."""
        parser = argparse.ArgumentParser()
        add_arguments(parser)
        target = self.directory / out
        self._capsys.readouterr()
        code = run(parser.parse_args([*map(str, sources), str(target), "--json", "--filters", filters, *options]))
        said = self._capsys.readouterr()
        summary = json.loads(said.out.splitlines()[-1]) if said.out else {}
        accounts = [summary.get("accounts", {}), *(file["accounts"] for file in summary.get("files", []))]
        for account in (account for each in accounts for account in each.values()):
            assert account["total"] == sum(sum(account[group].values()) for group in ("taken", "ignored", "rejected"))
        return Imported(code, summary, target, said.err)

    def text(self, text: str | bytes, *options: str, name: str = "in.log", **more: str) -> Imported:
        """A recording written first."""
        source = self.directory / name
        source.write_bytes(text.encode() if isinstance(text, str) else text)
        return self(source, *options, **more)
