from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.boat_config import SensorTable
from common.messages import SENSOR_STATES, SensorHealth
from common.units import NS_PER_S
from onboard.reading.line_quality import DamageWatch, Wire
from onboard.reading.sensor_health import LEAST_REFUSED, SensorMonitor


def monitor(role: str = "compass", **more: object) -> SensorMonitor:
    return SensorMonitor(SensorTable(id=f"{role}1", port="p", role=role, **more), 0)  # type: ignore[arg-type]


def report(watched: SensorMonitor, t_s: float) -> SensorHealth:
    health, _ = watched.report(int(t_s * NS_PER_S))
    assert health is not None
    return health


def test_missing_then_silent_then_delivering_then_silent_with_one_event_each() -> None:
    watched = monitor()
    assert report(watched, 0).state == "missing"
    watched.port_changed(None, NS_PER_S)
    assert report(watched, 1).state == "silent"
    watched.accept(2 * NS_PER_S, True)
    health, happened = watched.report(2 * NS_PER_S)
    assert health is not None
    assert health.state == "delivering"
    assert happened is not None
    assert happened.code == "sensor-delivering"
    codes = []
    for k in range(30, 200):
        _, happened = watched.report(k * NS_PER_S // 10)
        codes += [happened.code] if happened else []
    assert codes == ["sensor-silent"]


def test_health_is_reported_once_a_second_and_on_every_change() -> None:
    watched = monitor()
    watched.port_changed(None, 0)
    reports = [watched.report(k * NS_PER_S // 10)[0] for k in range(30)]
    assert sum(item is not None for item in reports) == 3
    watched.accept(int(2.95 * NS_PER_S), True)
    assert watched.report(int(2.95 * NS_PER_S))[0] is not None


def test_stale_after_follows_the_configured_rate() -> None:
    slow = monitor(rate_hz=0.1)
    slow.port_changed(None, 0)
    slow.accept(0, True)
    assert slow.state(49 * NS_PER_S)[0] == "delivering"
    assert slow.state(51 * NS_PER_S)[0] == "silent"


def test_an_event_sensor_is_never_silent() -> None:
    ais = monitor("ais")
    ais.port_changed(None, 0)
    assert ais.state(29 * NS_PER_S) == ("delivering", None)
    assert ais.state(10_000 * NS_PER_S) == ("delivering", "quiet for 10000 s")
    assert not ais.overdue(10_000 * NS_PER_S)


def test_bad_lines_are_counted_by_reason_and_named_while_nothing_is_readable() -> None:
    watched = monitor()
    watched.port_changed(None, 0)
    watched.wire.heard_bytes += 90
    watched.wire.readable += 1
    for reason in ("checksum", "checksum", "range"):
        watched.reject(reason)
    health = report(watched, 1)
    assert health.rejected == {"checksum": 2, "range": 1}
    assert health.reason is not None
    assert health.reason == "3 bad lines came, no good one: checksum 2, range 1"


def test_damage_that_was_told_stays_named_while_it_leaves_no_good_line_at_all() -> None:
    watched = monitor()
    watched.port_changed(None, 0)
    watched.accept(NS_PER_S, True)
    watched.report(NS_PER_S)
    watched.wire.heard_bytes += 90
    watched.wire.damage = "30 of 90 lines damaged: a second reader?"
    watched.reject("checksum")
    told = "1 bad lines came, no good one: checksum 1; 30 of 90 lines damaged: a second reader?"
    assert watched.state(20 * NS_PER_S) == ("silent", told)


def test_a_sensor_that_never_delivers_is_told_once_with_what_is_known_of_it() -> None:
    watched = monitor()
    watched.port_changed(None, 0)
    events = [watched.report(k * NS_PER_S // 10)[1] for k in range(200)]
    told = [item for item in events if item is not None]
    assert [item.code for item in told] == ["sensor-silent"]
    assert "nothing received yet" in told[0].text
    watched.port_changed(None, 20 * NS_PER_S)  # opened anew because of the silence: the same silence
    assert not any(watched.report((200 + k) * NS_PER_S // 10)[1] for k in range(1, 200))


def test_a_port_that_comes_back_has_its_time_before_silence_is_told() -> None:
    watched = monitor()
    watched.port_changed(None, 0)
    watched.accept(NS_PER_S, True)
    watched.report(NS_PER_S)
    watched.port_changed("the device is gone", 2 * NS_PER_S)
    watched.report(2 * NS_PER_S)
    watched.port_changed(None, 60 * NS_PER_S)
    assert not any(watched.report((600 + k) * NS_PER_S // 10)[1] for k in range(30))
    told = [watched.report((630 + k) * NS_PER_S // 10)[1] for k in range(30)]
    assert [item.code for item in told if item is not None] == ["sensor-silent"]


def test_the_rate_is_right_from_the_first_second() -> None:
    watched = monitor()
    watched.port_changed(None, 0)
    for k in range(10):
        watched.accept(k * NS_PER_S // 10, True)
    assert report(watched, 1).rate_hz == 10.0


def test_rate_is_of_measurements_not_of_lines() -> None:
    watched = monitor("gps")
    watched.port_changed(None, 0)
    health = None
    for k in range(1, 11):  # three sentences a second, one fix a second
        for third in range(3):
            watched.accept((3 * k + third) * NS_PER_S // 3, False)
        watched.measured()
        health = report(watched, k)
    assert health is not None
    assert health.rate_hz == 1.0


def beat(watched: SensorMonitor, times_s: list[int]) -> None:
    """Good lines at these seconds, asked ten times a second in between as the daemon does."""
    for begin_s, end_s in pairwise(times_s):
        watched.accept(begin_s * NS_PER_S, True)
        for k in range(10 * begin_s, 10 * end_s):
            watched.report(k * NS_PER_S // 10)
    watched.accept(times_s[-1] * NS_PER_S, True)


def test_a_sensor_slower_than_configured_is_not_reopened_for_ever() -> None:
    slow = monitor(rate_hz=10)
    slow.port_changed(None, 0)
    beat(slow, list(range(10, 100, 10)))
    # It sends every 10 s: five of these are its limit now, and not the 3 s of a 10 Hz compass.
    assert not slow.overdue((90 + 49) * NS_PER_S)
    assert slow.overdue((90 + 51) * NS_PER_S)
    assert "sends every 10 s, slower than configured" in str(slow.state((90 + 20) * NS_PER_S)[1])


@pytest.mark.parametrize("rate_hz", [1.0, 10.0, 20.0])
def test_a_sensor_of_the_configured_rate_that_falls_silent_is_not_called_slow(rate_hz: float) -> None:
    healthy = monitor(rate_hz=rate_hz)
    healthy.port_changed(None, 0)
    for number in range(int(30 * rate_hz)):
        healthy.accept(int(number * NS_PER_S / rate_hz * 1.001), True)
        healthy.report(int(number * NS_PER_S / rate_hz))
    state, reason = healthy.state(40 * NS_PER_S)
    assert state == "silent"
    assert reason is not None
    assert "slower" not in reason


def test_pauses_between_silent_reopenings_grow() -> None:
    watched = monitor()
    watched.port_changed(None, 0)
    reopened_s = []
    for k in range(3000):
        now_ns = k * NS_PER_S // 10
        if watched.overdue(now_ns):
            reopened_s.append(k / 10)
            watched.reopening(now_ns)
    pauses_s = [after - before for before, after in pairwise([0.0, *reopened_s])]
    assert pauses_s[:4] == pytest.approx([3.1, 6.1, 12.1, 24.1])
    assert max(pauses_s) <= 60.2


def test_wrong_baud_rate_is_named() -> None:
    watched = monitor()
    watched.port_changed(None, 0)
    watched.wire.heard_bytes += 500
    watched.wire.damaged += 5
    for _ in range(5):
        watched.reject("not-ascii")
    assert watched.state(NS_PER_S)[1] == "500 bytes came, none readable: wrong baud rate?"


def test_the_first_bytes_of_a_line_accuse_nobody() -> None:
    watched = monitor()
    watched.port_changed(None, 0)
    watched.wire.heard_bytes += 1
    assert watched.state(NS_PER_S)[1] == "1 bytes came, no whole line yet"
    watched.wire.heard_bytes += 600
    assert watched.state(NS_PER_S)[1] == "601 bytes came, no whole line in them"


def damage_events(shares: list[tuple[int, int]]) -> list[str]:
    """Codes told when in each second so many lines come whole and so many damaged."""
    wire = Wire()
    watch = DamageWatch(wire)
    codes = []
    for second, (whole, bad) in enumerate(shares):
        wire.readable += whole
        wire.damaged += bad
        if (found := watch.look(second * NS_PER_S)) is not None:
            codes.append(found[0])
    return codes


def test_damaged_lines_are_told_once_and_their_end_once() -> None:
    thief = [(10, 0)] * 20 + [(6, 4)] * 60 + [(10, 0)] * 30
    assert damage_events(thief) == ["lines-damaged", "lines-clean"]


def test_a_few_damaged_lines_are_no_event() -> None:
    assert damage_events([(10, 1)] * 100) == []
    assert damage_events([(10, 0)] * 20 + [(0, 10)] * 2 + [(10, 0)] * 20) == []


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["accept", "reject", "open", "lose", "reopen", "bytes", "wait"]), st.integers(0, 20_000)
        ),
        max_size=60,
    ),
    st.sampled_from(["gps", "compass", "imu", "ais", "radar"]),
)
def test_any_story_gives_one_of_three_states_and_no_more_silences_told_than_ended(
    story: list[tuple[str, int]], role: str
) -> None:
    watched, now_ns, codes = monitor(role), 0, []
    for what, pause_ms in story:
        now_ns += pause_ms * NS_PER_S // 1000
        match what:
            case "accept":
                watched.accept(now_ns, True)
            case "reject":
                watched.reject("checksum")
            case "open":
                watched.port_changed(None, now_ns)
            case "lose":
                watched.port_changed("the device is gone", now_ns)
            case "reopen":
                watched.reopening(now_ns)
            case "bytes":
                watched.wire.heard_bytes += 10
        health, happening = watched.report(now_ns)
        codes += [] if happening is None else [happening.code]
        state, reason = watched.state(now_ns)
        assert state in SENSOR_STATES
        assert health is None or health.state == state
        assert len(reason or "") <= 256
        assert state != "silent" or reason
    silences = [code for code in codes if code == "sensor-silent"]
    assert len(silences) <= 1 + sum(what in ("accept", "lose") for what, _ in story)
    refused = sum(what == "reject" for what, _ in story)
    assert role not in ("ais", "radar") or not codes or refused >= LEAST_REFUSED  # quiet is no fault of theirs
