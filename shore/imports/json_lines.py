"""JSON text stream: arrays, indented objects and several objects a line become one object a line (NDJSON)."""

import json
from collections.abc import Iterable, Iterator
from typing import Final

LONGEST_OBJECT: Final = 400
"""So many lines of an indented object at most."""
_DECODER: Final = json.JSONDecoder()
_BETWEEN: Final = ",[] \t\r\n"


def one_object_a_line(lines: Iterable[str]) -> Iterator[str]:
    """Each object on a line of its own, with what stood before it (a time stamp); what is none as it is.

    Lines that hold nothing but brackets of an array are left out.
    """
    waiting: list[str] = []
    for line in lines:
        if waiting:
            text = "\n".join((*waiting, line))
            objects, is_begun = _objects(text)
            if is_begun and len(waiting) < LONGEST_OBJECT:
                waiting.append(line)
                continue
            if objects is not None:
                waiting = []
                yield from objects
                continue
            yield from waiting
            waiting = []
        objects, is_begun = _objects(line)
        if is_begun:
            waiting = [line]
        else:
            yield from (line,) if objects is None else objects
    yield from waiting


def _objects(text: str) -> tuple[list[str] | None, bool]:
    """The objects of a text, `None` = it is none; True = it ends within an object, between two of its parts."""
    bare = text.strip()
    if bare.startswith("{") and bare.endswith("}") and len(bare) > 2 and "\n" not in bare:
        return None, False  # as almost always: the reader decodes it
    if not bare.strip(_BETWEEN):
        return [], False
    found: list[str] = []
    before = begin = text.find("{")
    prefix = text[: max(0, begin)].lstrip("[, \t")
    while begin >= 0:
        if text[before:begin].strip(_BETWEEN):
            return None, False
        try:
            _, end = _DECODER.raw_decode(text, begin)
        except (ValueError, RecursionError) as error:
            is_open = isinstance(error, json.JSONDecodeError) and error.pos >= len(text.rstrip())
            return None, is_open and not prefix and not found
        found.append(prefix + text[begin:end])
        prefix = ""
        before, begin = end, text.find("{", end)
    return (found, False) if found and not text[before:].strip(_BETWEEN) else (None, False)
