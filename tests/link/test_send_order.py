from common.link_messages import FrameRange, Lease
from onboard.link.send_order import LiveFrame, SendOrder, gone_of
from onboard.spool import Run

BOOT = "ab" * 8
OLD = "cd" * 8


def lease(received: int = 0, *missing: FrameRange) -> Lease:
    return Lease(session="1", boot_id=BOOT, window=1000, received=received, t_ns=0, missing=missing)


def live(seq: int) -> LiveFrame:
    return LiveFrame(seq, b"", bytes(100))


def test_the_newest_is_next_and_before_it_the_last_fix_that_found_no_room() -> None:
    order = SendOrder(live_next=3)
    assert order.next_live(live(5), None) == live(5)
    assert order.next_live(live(5), live(2)) == live(5)  # the fix is out
    assert order.next_live(live(5), live(4)) == live(4)
    order.sent_live(live(4))
    assert order.next_live(live(5), live(4)) == live(5)
    order.sent_live(live(5))
    assert order.next_live(live(5), live(5)) is None


def test_missing_frames_have_half_of_the_window_and_the_newest_all_of_it() -> None:
    order = SendOrder()
    order.renew(lease(0, FrameRange(BOOT, 0, 99)), is_first=True)
    assert order.next_missing() == FrameRange(BOOT, 0, 99)
    order.sent_missing(BOOT, 0, 400)
    assert (order.next_missing(), order.fill_room) == (FrameRange(BOOT, 1, 99), 100)
    assert order.has_room(100, fill=True)
    assert not order.has_room(101, fill=True)
    assert order.has_room(600, fill=False)
    assert not order.has_room(601, fill=False)
    order.sent_missing(BOOT, 1, 100)
    assert order.next_missing() is None
    order.renew(lease(500, FrameRange(BOOT, 2, 99)), is_first=False)
    assert order.next_missing() == FrameRange(BOOT, 2, 99)


def test_the_oldest_goes_first_and_what_is_on_the_way_is_not_sent_again() -> None:
    order = SendOrder()
    order.renew(lease(0, FrameRange(OLD, 7, 8), FrameRange(BOOT, 0, 2)), is_first=True)
    order.sent_missing(OLD, 7, 50)
    order.renew(lease(0, FrameRange(OLD, 7, 8), FrameRange(BOOT, 0, 2)), is_first=False)
    assert list(order.wanted) == [FrameRange(OLD, 8, 8), FrameRange(BOOT, 0, 2)]
    order.renew(lease(50, FrameRange(OLD, 7, 8)), is_first=False)  # what was sent after it came, it did not
    assert list(order.wanted) == [FrameRange(OLD, 7, 8)]
    order.sent_missing(OLD, 7, 50)
    order.renew(lease(50, FrameRange(OLD, 7, 8)), is_first=True)  # another connection: nothing is on the way
    assert (list(order.wanted), order.on_the_way) == ([FrameRange(OLD, 7, 8)], 0)


def test_gone_is_what_no_start_holds_any_more_but_not_what_is_not_made_yet() -> None:
    held = [Run(OLD, 1, 10, 20), Run(BOOT, 2, 5, 9)]
    asked = [FrameRange(OLD, 8, 25), FrameRange(BOOT, 3, 30), FrameRange("ef" * 8, 0, 1), FrameRange(BOOT, 5, 8)]
    gone = [FrameRange(OLD, 8, 9), FrameRange(OLD, 20, 25), FrameRange(BOOT, 3, 4), FrameRange("ef" * 8, 0, 1)]
    assert gone_of(asked, held) == gone
