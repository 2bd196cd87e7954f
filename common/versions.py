"""Protocol versions: board and station must have the same two numbers, that of the frames and that of the link."""

from typing import Any, Final

SCHEMA_VERSION: Final = 1
"""Version of the frames (`common.messages`); raised only when an old reader could misread a new frame."""
LINK_VERSION: Final = 2
"""Version of the messages of the link (`common.link_messages`); 1 had neither leases nor keys."""


def schema_fault(other: object) -> str | None:
    """Why we cannot read frames of schema `other`, or `None`: the numbers must be equal (`SCHEMA_VERSION`)."""
    return _fault("schema", other, SCHEMA_VERSION)


def version_fault(greeting: dict[str, Any]) -> str | None:
    """Why we cannot talk to the sender of this `hello` or `connected`, or None: both numbers must be equal to ours."""
    return schema_fault(greeting.get("schema")) or _fault("link", greeting.get("link", 1), LINK_VERSION)


def _fault(name: str, other: object, ours: int) -> str | None:
    if not isinstance(other, int) or isinstance(other, bool):
        return f"the other side names no {name} version"
    if other == ours:
        return None
    newer = "the other side" if other > ours else "this side"
    return f"{name} {other} there, {ours} here: {newer} is newer, install the same version on both"
