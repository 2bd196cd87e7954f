"""The link's state machine by itself: its table is the one in its docstring, and its rules hold whatever happens."""

from collections.abc import Callable
from typing import Final

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from common.units import NS_PER_MS, NS_PER_S
from shore.link import session_state as theory
from shore.link.session_state import LinkMachine, LinkState, Trigger
from shore.link.transport import HandshakeFault

WINDOW: Final = 4096

PULLED: Final[dict[Trigger, Callable[[LinkMachine, int], object]]] = {
    Trigger.CONNECT: LinkMachine.connect,
    Trigger.HEARD: LinkMachine.heard,
    Trigger.QUIET: LinkMachine.watch,
    Trigger.REFUSED: lambda link, _: link.judge(HandshakeFault.UNKNOWN_KEY),
    Trigger.MOVE: LinkMachine.move,
    Trigger.CLOSE: lambda link, _: link.close(),
}
WAYS: Final[dict[LinkState, tuple[Trigger, ...]]] = {
    LinkState.NEW: (),
    LinkState.GREETING: (Trigger.CONNECT,),
    LinkState.RUNNING: (Trigger.CONNECT, Trigger.HEARD),
    LinkState.SILENT: (Trigger.CONNECT, Trigger.HEARD, Trigger.MOVE),
    LinkState.REFUSED: (Trigger.CONNECT, Trigger.HEARD, Trigger.REFUSED),
    LinkState.CLOSED: (Trigger.CLOSE,),
}


def written_table() -> list[tuple[LinkState, Trigger, LinkState | None]]:
    """Cells of the table at the head of the module."""
    rows = [line.split() for line in (theory.__doc__ or "").splitlines() if line.startswith("    ")]
    triggers = [Trigger[name] for name in rows[0][1:]]
    return [
        (LinkState[row[0]], trigger, None if name == "-" else LinkState[name])
        for row in rows[1:]
        for trigger, name in zip(triggers, row[1:], strict=False)
    ]


@pytest.mark.parametrize(("state", "trigger", "after"), written_table())
def test_each_trigger_moves_each_state_as_the_docstring_says(
    state: LinkState, trigger: Trigger, after: LinkState | None
) -> None:
    link = LinkMachine(0, WINDOW)
    for now_ns, step in enumerate(WAYS[state]):
        PULLED[step](link, now_ns)
    assert link.state is state
    if after is None:
        with pytest.raises(AssertionError, match=f"{trigger.name} in {state.name}"):
            PULLED[trigger](link, 10 * NS_PER_S)
    else:
        PULLED[trigger](link, 10 * NS_PER_S)
        assert link.state is after
        assert (link.verdict is not None) == (after is LinkState.REFUSED)


def test_the_docstring_has_every_cell() -> None:
    assert len({(state, trigger) for state, trigger, _ in written_table()}) == len(LinkState) * len(Trigger)


class Session(RuleBasedStateMachine):
    """A session after its greeting, beside what a bystander notes of it. No two things happen at the same time."""

    @initialize()
    def joins(self) -> None:
        self.now_ns = self.opened_ns = 10**12
        self.link = LinkMachine(self.now_ns, WINDOW)
        self.link.connect(self.now_ns)
        self.unread_bytes = 0
        self.has_hole = False
        self.word()
        self.leased_ns: int | None = None

    def passes(self, ms: int) -> None:
        self.now_ns += ms * NS_PER_MS

    @rule()
    def word(self) -> None:
        self.passes(1)
        self.link.heard(self.now_ns)
        self.word_ns, self.broken, self.is_refused, self.given_up = self.now_ns, 0, False, 0

    @rule(size=st.integers(1, WINDOW))
    def frame(self, size: int) -> None:
        self.word()
        self.link.received_bytes += size
        self.unread_bytes += size

    @rule(verdict=st.sampled_from([HandshakeFault.UNKNOWN_KEY, HandshakeFault.MISMATCH, *[HandshakeFault.BROKEN] * 8]))
    def handshake_fails(self, verdict: HandshakeFault) -> None:
        self.passes(1)
        self.broken += verdict is HandshakeFault.BROKEN
        is_final = verdict is not HandshakeFault.BROKEN or self.broken >= 5
        assert self.link.judge(verdict) == is_final
        self.is_refused |= is_final

    @rule()
    def moves(self) -> None:
        self.passes(1)
        self.link.move(self.now_ns)
        self.opened_ns, self.leased_ns = self.now_ns, None

    @rule(ms=st.one_of(st.integers(1, 400), st.integers(1, 7000)))
    def looks(self, ms: int) -> None:
        """Nothing waits; the first connection after a word has 1.5 s, each later one twice as long, up to 6 s."""
        self.passes(ms)
        patience_ns = min(1_500 * 2**self.given_up, 6_000) * NS_PER_MS
        is_over = self.now_ns - max(self.word_ns, self.opened_ns) > patience_ns
        assert self.link.watch(self.now_ns) == is_over
        if is_over:
            self.given_up += self.word_ns < self.opened_ns
            self.opened_ns, self.leased_ns = self.now_ns, None

    @rule()
    def hole_is_seen(self) -> None:
        self.link.ask_soon()
        self.has_hole = True

    @rule(ms=st.integers(1, 300))
    def leases(self, ms: int) -> None:
        self.passes(ms)
        if self.link.due_ns(self.now_ns) <= self.now_ns:
            self.link.asked(self.now_ns)
            self.leased_ns, self.unread_bytes, self.has_hole = self.now_ns, 0, False

    @invariant()
    def the_state_is_what_a_bystander_would_say(self) -> None:
        heard = LinkState.RUNNING if self.word_ns > self.opened_ns else LinkState.SILENT
        assert self.link.state is (LinkState.REFUSED if self.is_refused else heard)
        assert (self.link.verdict is not None) == self.is_refused

    @invariant()
    def a_lease_is_never_late_and_never_wasted(self) -> None:
        due_ns = self.link.due_ns(self.now_ns)
        if self.leased_ns is None or self.unread_bytes >= WINDOW // 2:
            assert due_ns <= self.now_ns
        else:
            assert due_ns - self.leased_ns == (100 if self.has_hole else 250) * NS_PER_MS

    @invariant()
    def silence_counts_from_the_last_word(self) -> None:
        assert self.link.silent_ns(self.now_ns) == self.now_ns - self.word_ns


TestSession = Session.TestCase
TestSession.settings = settings(max_examples=100, stateful_step_count=40, deadline=None)
