"""Words for people (grammatical number, spelling suggestions): `1 port`, `did you mean fuzzy?`, what to install."""

import sys
from collections.abc import Iterable
from difflib import get_close_matches


def counted(count: int, one: str, many: str = "") -> str:
    """`1 port`, `2 ports`, `12,034 frames`. many: where it is not `one` with an s behind it."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"


def did_you_mean(given: str, known: Iterable[str]) -> str:
    """`, did you mean fuzzy?` behind a name that is not known; empty when none of the known ones is near."""
    near = get_close_matches(given, list(known), 1)
    return f", did you mean {near[0]}?" if near else ""


def how_to_install(extra: str) -> str:
    """The cure for a missing package. Wayfix is on no index: it is installed from its own directory."""
    return f"{sys.executable} -m pip install '.[{extra}]', in the directory of Wayfix"
