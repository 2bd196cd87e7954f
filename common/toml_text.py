"""TOML serialization: tables as text that `tomllib` reads back, for files and for screens.

A text is written so that it cannot steer a terminal: what is not printable is escaped.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(table: Mapping[str, Any]) -> str:
    """The lines of `toml_lines`, each ended by a newline."""
    return "".join(f"{line}\n" for line in toml_lines(table))


def toml_lines(table: Mapping[str, Any], path: str = "") -> Iterator[str]:
    """A table as TOML, an empty line before each [table] and [[table]]; `None` is left out, TOML has no word for it.

    Values: text without lone surrogates, bool, int, float, lists and tables of these; of anything else its `str`.
    path: in front of the names of the tables inside.
    """
    for key, value in table.items():
        if value is not None and not _is_table(value):
            yield f"{_key(key)} = {_value(value)}"
    for key, value in table.items():
        name = f"{path}{_key(key)}"
        if isinstance(value, Mapping):
            yield f"\n[{name}]"
            yield from toml_lines(value, f"{name}.")
        elif _is_table(value):
            for item in value:
                yield f"\n[[{name}]]"
                yield from toml_lines(item, f"{name}.")


def _is_table(value: Any) -> bool:
    """A table, or a list of nothing but tables."""
    return isinstance(value, Mapping) or (
        isinstance(value, list | tuple) and bool(value) and all(isinstance(item, Mapping) for item in value)
    )


def _key(key: object) -> str:
    text = str(key)
    return text if _BARE_KEY.fullmatch(text) else _quoted(text)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return str(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(item) for item in value if item is not None)}]"
    if isinstance(value, Mapping):
        pairs = (f"{_key(key)} = {_value(item)}" for key, item in value.items() if item is not None)
        return f"{{{', '.join(pairs)}}}"
    return _quoted(str(value))


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(letter if letter.isprintable() else f"\\U{ord(letter):08x}" for letter in escaped) + '"'
