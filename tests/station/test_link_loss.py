"""The loss of a link as events: in turn, once each, with the time it took."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from common.units import NS_PER_S
from shore.live.link_loss import LinkLoss


def test_a_loss_is_said_once_and_so_are_its_end_and_the_last_gap() -> None:
    loss = LinkLoss()
    assert loss.heard(0, 5, 0) is None, "nothing was lost yet"
    assert loss.frame(0, 0) is None
    lost = loss.silent(3.04, 10 * NS_PER_S, 77)
    assert lost is not None
    assert (lost.code, lost.t_ns, lost.evidence) == ("link-lost", 77, {"age_s": 3.0})
    assert loss.silent(4.0, 11 * NS_PER_S, 77) is None
    assert loss.lost_s(12 * NS_PER_S) == 5.04
    assert loss.heard(0, 5, 0) is None, "the board answers, but no frame has come yet"
    restored = loss.frame(12 * NS_PER_S, 99)
    assert restored is not None
    assert (restored.code, restored.t_ns, restored.evidence) == ("link-restored", 99, {"age_s": 5.0})
    assert loss.lost_s(13 * NS_PER_S) is None
    assert loss.heard(2, 8, 0) is None
    filled = loss.heard(0, 10, 101)
    assert filled is not None
    assert (filled.code, filled.t_ns, filled.evidence) == ("gaps-filled", 101, {"count": 10})
    assert loss.heard(0, 11, 0) is None


@given(st.lists(st.sampled_from(["silent", "frame", "heard", "missing"]), max_size=30))
def test_events_come_in_turn_whatever_happens(what: list[str]) -> None:
    loss, codes = LinkLoss(), []
    for now_s, each in enumerate(what, 10):
        now_ns = now_s * NS_PER_S
        if each == "silent":
            event = loss.silent(3.5, now_ns, 0)
        elif each == "frame":
            event = loss.frame(now_ns, 0)
        else:
            event = loss.heard(int(each == "missing"), 1, 0)
        codes += [] if event is None else [event.code]
        assert loss.is_lost == (loss.lost_s(now_ns) is not None)
    after = {
        "link-lost": {"link-restored"},
        "link-restored": {"link-lost", "gaps-filled"},
        "gaps-filled": {"link-lost"},
    }
    assert codes[:1] in ([], ["link-lost"])
    assert all(second in after[first] for first, second in pairwise(codes))
