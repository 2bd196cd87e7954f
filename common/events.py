"""Events (alarms, notices): made from the catalogue, and said to a person. Both sides raise events only from here."""

from typing import Final

from common.event_kinds import EVENTS, STATION
from common.messages import Event

NOTHING_TO_DO: Final = "nothing to do"


def line_of(happening: Event) -> str:
    """An event as one line for a person: the text, and the cure where there is something to do.

    Evidence named `cure` wins over the table: where the cause is known, what to do is known better.
    """
    kind = EVENTS.get(happening.code)
    cure = happening.evidence.get("cure") or (NOTHING_TO_DO if kind is None else kind.cure)
    return happening.text if cure == NOTHING_TO_DO else f"{happening.text}; {cure}"


def is_of_station(code: str) -> bool:
    """Whether the station says this of itself: no frame brings it, so no replay makes it."""
    kind = EVENTS.get(code)
    return kind is not None and kind.side == STATION


def event(code: str, t_ns: int, source: str, **evidence: str | float | bool | None) -> Event:
    """Make an event of the table; `evidence` fills the text's placeholders and travels along."""
    kind = EVENTS[code]
    text = kind.text.format(**evidence)[:512]
    return Event(t_ns=t_ns, source=source, code=code, level=kind.level, text=text, evidence=dict(evidence))
