from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages import SENSOR_STATES
from common.units import NS_PER_S
from onboard.reading.reopen_pauses import ReopenPauses
from onboard.reading.silence_watchdog import SHOWN, TABLE, Delivery, Input, State

STALE_NS = 3 * NS_PER_S


def steps(inputs: list[Input]) -> tuple[State, list[str]]:
    """Where the table leads from a closed port, and the events on the way."""
    state, codes = State.MISSING, []
    for moved_by in inputs:
        state, code = TABLE.get((state, moved_by), (state, None))
        codes += [] if code is None else [code]
    return state, codes


def test_every_state_is_shown_by_a_word_that_both_sides_know() -> None:
    assert set(SHOWN) == set(State)
    assert set(SHOWN.values()) == set(SENSOR_STATES)


def test_lost_leads_from_every_state_to_missing_and_overdue_from_every_other_to_an_outage() -> None:
    for state in set(State) - {State.MISSING}:
        assert TABLE[state, Input.LOST] == (State.MISSING, None)
        if state is not State.OUTAGE:
            assert TABLE[state, Input.OVERDUE] == (State.OUTAGE, "sensor-silent")


@given(st.lists(st.sampled_from(Input), max_size=60))
def test_between_two_losses_the_events_take_turns(inputs: list[Input]) -> None:
    stretches: list[list[Input]] = [[]]
    for moved_by in inputs:
        stretches[-1].append(moved_by)
        if moved_by is Input.LOST:
            stretches.append([])
    for stretch in stretches:
        assert all(first != second for first, second in pairwise(steps(stretch)[1]))


@given(st.lists(st.sampled_from(Input), max_size=60))
def test_only_a_fresh_line_of_an_open_port_makes_a_sensor_deliver(inputs: list[Input]) -> None:
    for end in range(1, len(inputs) + 1):
        state, _ = steps(inputs[:end])
        is_open = Input.OPENED in inputs[:end] and state is not State.MISSING
        assert (state is State.DELIVERING) <= (is_open and inputs[end - 1] not in (Input.OPENED, Input.LOST))
        if inputs[end - 1] is Input.FRESH and is_open:
            assert state is State.DELIVERING


def test_asking_for_the_state_moves_nothing() -> None:
    delivery = Delivery(periodic=True, stale_ns=STALE_NS, started_ns=0)
    delivery.opened(0)
    assert delivery.state_at(4 * NS_PER_S) is State.OUTAGE
    assert delivery.state_at(NS_PER_S) is State.WAITING
    assert delivery.look(4 * NS_PER_S) == "sensor-silent"
    assert delivery.look(5 * NS_PER_S) is None


def test_a_pause_shorter_than_the_limit_is_late_and_no_event() -> None:
    delivery = Delivery(periodic=True, stale_ns=STALE_NS, started_ns=0)
    delivery.opened(0)
    for second in (1, 3, 5, 7):  # a period of 2 s: the limit is 10 s
        delivery.good(second * NS_PER_S)
    assert delivery.look(7 * NS_PER_S) == "sensor-delivering"
    assert delivery.look(17 * NS_PER_S) is None
    assert delivery.state_at(17 * NS_PER_S) is State.LATE
    delivery.good(17 * NS_PER_S)
    assert delivery.look(17 * NS_PER_S) is None
    assert delivery.state_at(17 * NS_PER_S) is State.DELIVERING


@pytest.mark.parametrize(("attempts", "pause_s"), [(0, 3), (1, 6), (2, 12), (4, 48), (5, 60), (50, 60)])
def test_each_attempt_to_reopen_waits_twice_as_long_up_to_a_minute(attempts: int, pause_s: int) -> None:
    pauses = ReopenPauses(0)
    for _ in range(attempts):
        pauses.attempted(0)
    assert not pauses.is_due(pause_s * NS_PER_S, None, STALE_NS)
    assert pauses.is_due(pause_s * NS_PER_S + 1, None, STALE_NS)
    pauses.succeeded()
    assert pauses.is_due(STALE_NS + 1, None, STALE_NS)
