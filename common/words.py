"""Plural forms (grammatical number) of what is counted, for every sentence that has a count."""


def counted(count: int, one: str, many: str = "") -> str:
    """`1 port`, `2 ports`, `12,034 frames`. many: where it is not `one` with an s behind it."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"
