"""Reader of serial recordings: `wayfix-onboard convert`, the boat's own decoders, in a process of its own."""

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

from common.errors import WayfixError
from common.units import NS_PER_MS
from common.words import how_to_install
from shore.imports.line_counts import Account, Rejected
from shore.imports.reader import Lines
from shore.imports.recognise import SERVER_LINE
from shore.imports.signalk import stamp_ns


def convert(source: Path, target: Path, options: Sequence[str], say: Callable[[str], None]) -> dict[str, Any]:
    """Frames file `target` of the recording; convert's own summary.

    Raises WayfixError with the words of `convert`, or when it is not installed. Its progress goes to `say`.
    """
    # Beside the interpreter: found also when the virtual environment is not activated.
    program = Path(sys.executable).with_name("wayfix-onboard")
    if not program.exists():
        cure = how_to_install("onboard,shore")
        raise WayfixError("serial recordings need wayfix-onboard, which is not here", str(program.parent), cure)
    command = [str(program), "convert", str(source), str(target), "--json", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:  # noqa: S603
        assert process.stdout is not None
        assert process.stderr is not None
        last = ""
        try:
            for line in process.stderr:
                last = line.rstrip("\n")
                if last.endswith("%)"):
                    say(last)
            # A few lines only: they wait in the pipe without holding the process up.
            words = process.stdout.read().splitlines()
        except BaseException:
            process.terminate()
            raise
    if process.returncode not in (0, 1) or not words:
        raise WayfixError(last.removeprefix("wayfix-onboard: ") or f"convert ended with {process.returncode}")
    summary: dict[str, Any] = json.loads(words[-1])
    return summary


def account_of(summary: dict[str, Any]) -> Account:
    """Every line of the recording, from convert's summary."""
    account = Account("lines")
    for sensor, kinds in summary["accepted"].items():
        account.taken.update({f"{sensor} {kind}": count for kind, count in kinds.items()})
    account.ignored.update(summary["ignored"])
    account.ignored.update(summary["skipped"])
    account.rejected.update(summary["rejected"])
    if summary["too_long"]:
        account.rejected["longer than 512 bytes"] += summary["too_long"]
    return account


class ServerLog:
    """The sentences in a Signal K server's log, written out as a recording of a port with the server's time stamps."""

    def __init__(self, source: Path, target: Path) -> None:
        """Reads `source`, writes its sentences to `target`."""
        self.ignored: Counter[str] = Counter()
        self.rejected: Counter[str] = Counter()
        self.sentences = self.deltas = 0
        self.providers: Counter[str] = Counter()
        self.first_ns: int | None = None
        """Time of the first sentence by the server's clock, ns since 1970; `None` = there was none."""
        with target.open("wb") as stream:
            for line in Lines(source):
                payload = self._payload(line)
                if payload is not None:
                    stream.write(payload.encode(errors="replace") + b"\r\n")

    def _payload(self, line: str) -> str | None:
        match = SERVER_LINE.match(line)
        if match is None:
            self.rejected["no line of a server's log"] += 1
            return None
        payload = match[3].strip()
        if payload.startswith("{"):
            self.deltas += 1
            self.ignored["delta"] += 1
            return None
        if payload[:1] not in ("$", "!", "\\"):
            self.ignored["NMEA 2000 or other"] += 1
            return None
        try:
            t_ns = stamp_ns(match[1])
        except Rejected as reason:
            self.rejected[str(reason)] += 1
            return None
        self.first_ns = t_ns if self.first_ns is None else self.first_ns
        self.sentences += 1
        self.providers[match[2]] += 1
        return payload if payload.startswith("\\") else f"{_tag_block(t_ns)}{payload}"


def _tag_block(t_ns: int) -> str:
    r"""The tag block of a time (NMEA 4.10): `\c:1796040000000*50\`, ms since 1970."""
    text = f"c:{t_ns // NS_PER_MS}"
    return f"\\{text}*{reduce(xor, text.encode(), 0):02X}\\"
