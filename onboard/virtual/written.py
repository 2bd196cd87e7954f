"""Configuration writer (TOML) and sent-data log of the virtual boat, whatever it plays."""

import json
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from common.sensors import BoatConfig
from common.settings import as_dict

WRITTEN_BY: Final = "# Written by `wayfix-onboard virtual`"


def config_text(head: str, config: BoatConfig) -> str:
    """`config` as TOML, every key that has a value written out; head: what it is for, one or more lines."""
    lines = head.splitlines()
    parts = [f"{WRITTEN_BY} {lines[0]}\n" + "".join(f"# {line}\n" for line in lines[1:])]
    for name, content in as_dict(config).items():
        tables = content if isinstance(content, list) else [content]
        title = f"[[{name}]]" if isinstance(content, list) else f"[{name}]"
        for table in tables:
            # JSON's texts, numbers, booleans and lists are TOML's too.
            rows = "".join(f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in table.items())
            parts.append(f"{title}\n{rows}")
    return "\n".join(parts)


class SentFile:
    """One JSON line for each measurement or line whose last byte went out, and a count for each sensor or port."""

    def __init__(self, path: Path, key: str, names: Iterable[str]) -> None:
        """Key: what is counted, `sensor` or `port`; names: all there are."""
        self.counts = dict.fromkeys(names, 0)
        self._key = key
        # By line: whoever reads while the boat still sails sees whole lines.
        self._stream = path.open("w", encoding="ascii", buffering=1)

    def note(self, record: dict[str, Any]) -> None:
        """Write one record."""
        self.counts[record[self._key]] += 1
        if self._stream.closed:
            return
        try:
            self._stream.write(json.dumps(record, separators=(",", ":")) + "\n")
        except OSError as error:  # a full disk ends the record, not the voyage
            sys.stderr.write(f"{self._stream.name} cannot be written any further ({error.strerror})\n")
            with suppress(OSError):
                self._stream.close()

    def close(self) -> None:
        """Close the file."""
        self._stream.close()
