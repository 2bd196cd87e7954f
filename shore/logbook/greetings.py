"""Greetings of the board in a log (boot ordering): each says in which order the starts are whose frames the log holds.

The first stands in the `start` record. A board that comes back with the same configuration greets once more: that is a
record of its own, `greeted`. What came after the end of a trip is of starts that only a later greeting names: that one
stands in the record `completed` before it. Older logs lack both, and there the numbers of the starts decide.
"""

from typing import Any, Final

from common.boat_start import StartOrder, boots_named

GREETED: Final = "greeted"
"""Kind of the `/session` record of a greeting that came within a session."""
COMPLETED: Final = "completed"
"""Kind of the `/session` record behind which frames stand that came after the end of a trip."""


def greeted_record(connected: dict[str, Any]) -> dict[str, Any]:
    """What a log keeps of a greeting that came within a session. connected: the greeting."""
    return {"kind": GREETED, "starts": list(boots_named(connected.get("runs")))}


def take_greeting(starts: StartOrder, session: dict[str, Any]) -> None:
    """Learn the order of the starts from a `/session` record; others say nothing."""
    if session.get("kind") == "start":
        connected = session.get("connected")
        starts.greeted(boots_named(connected.get("runs") if isinstance(connected, dict) else None))
    elif session.get("kind") in (GREETED, COMPLETED) and isinstance(named := session.get("starts"), list):
        starts.greeted(boot_id for boot_id in named if isinstance(boot_id, str))
