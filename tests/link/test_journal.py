import pytest

from common.events import event
from common.messages import Event
from onboard.journal import Journal


def test_an_event_has_the_time_at_which_it_is_told_and_the_source_of_its_journal() -> None:
    told: list[Event] = []
    times_ns = iter([10, 20, 30])
    journal = Journal(told.append, lambda: next(times_ns))
    link = journal.child("link")
    journal.tell("state-unusable", reason="no room")
    link.tell("client-joined", client="laptop")
    link.child("gps1").tell("mark", text="here", client="laptop")
    assert told == [
        event("state-unusable", 10, "daemon", reason="no room"),
        event("client-joined", 20, "link", client="laptop"),
        event("mark", 30, "gps1", text="here", client="laptop"),
    ]


def test_a_caller_that_has_read_the_clock_gives_its_time() -> None:
    told: list[Event] = []

    def clock() -> int:
        raise AssertionError("the clock was read a second time")

    Journal(told.append, clock).tell_at(7, "ticks-missed", count=3)
    assert told == [event("ticks-missed", 7, "daemon", count=3)]


def test_a_code_outside_the_table_is_an_error_of_ours() -> None:
    journal = Journal(lambda _event: None, lambda: 0)
    with pytest.raises(KeyError):
        journal.tell("daemon-sang")
