"""Sent-data log (JSON lines) of the virtual boat: a record of everything that went out."""

import json
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any


class SentFile:
    """One JSON line for each measurement or line whose last byte went out, and a count for each sensor or port."""

    def __init__(self, path: Path, key: str, names: Iterable[str]) -> None:
        """Key: what is counted, `sensor` or `port`; names: all there are."""
        self.counts = dict.fromkeys(names, 0)
        self._key = key
        # By line: a reader sees whole lines while the boat still sails.
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
