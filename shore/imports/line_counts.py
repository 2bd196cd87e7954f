"""Accounting of a recording: each line, row or value is taken, ignored, or rejected with a reason."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any


@dataclass(slots=True)
class Account:
    """Counts of one unit; the three groups together are all there was."""

    unit: str
    """What is counted, in the plural: lines, rows, values."""
    taken: Counter[str] = field(default_factory=Counter)
    """Number of units that were taken, by kind."""
    ignored: Counter[str] = field(default_factory=Counter)
    """Number of units that were ignored, by kind: they are well-formed, but a log of the boat does not hold them."""
    rejected: Counter[str] = field(default_factory=Counter)
    """Number of units that were rejected, by reason."""
    first: dict[str, str] = field(default_factory=dict)
    """Where each reason was met first: line, column and value, where the reader knows them."""

    def reject(self, reason: str, where: str) -> None:
        """Count one more that was rejected, and keep the first place of each reason."""
        self.rejected[reason] += 1
        self.first.setdefault(reason, where)

    def too_little(self) -> str | None:
        """Why less than half was used, as a sentence; `None` = more was. What was ignored is of no use to any log."""
        rejected, taken = self.rejected.total(), self.taken.total()
        if rejected <= taken:
            return None
        reasons = ", ".join(f"{reason} ({count})" for reason, count in self.rejected.most_common(3))
        first = self.first.get(self.rejected.most_common(1)[0][0])
        where = "" if first is None else f"; the first is {first}"
        return f"less than half was used: {rejected} of {rejected + taken} {self.unit} were refused: {reasons}{where}"

    @property
    def total(self) -> int:
        """Number of all units."""
        return self.taken.total() + self.ignored.total() + self.rejected.total()

    def as_record(self) -> dict[str, Any]:
        """The counts for JSON, sorted, so that the same recording gives the same bytes."""
        groups = {name: dict(sorted(getattr(self, name).items())) for name in ("taken", "ignored", "rejected")}
        return {"total": self.total, **groups} | ({"first": dict(sorted(self.first.items()))} if self.first else {})

    def words(self) -> Iterator[str]:
        """The counts for a person: a heading and a row for each group."""
        yield f"{self.total} {self.unit}"
        for name in ("taken", "ignored", "rejected"):
            counts: Counter[str] = getattr(self, name)
            if counts:
                details = ", ".join(f"{kind} {count}" for kind, count in sorted(counts.items()))
                yield f"  {name:9} {counts.total():>8}   {details}"
        for reason, where in sorted(self.first.items()):
            yield f"  first of `{reason}`: {where}"


class Rejected(Exception):  # noqa: N818 (a counted result, no fault of the program)
    """Something in a recording that cannot be right; the text is the reason it is counted under."""
