from common.messages import SensorHealth
from common.sensors import SensorTable
from common.units import NS_PER_S
from onboard.health import SensorMonitor


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
    assert ais.state(10_000 * NS_PER_S) == ("delivering", None)
    assert not ais.overdue(10_000 * NS_PER_S)


def test_bad_lines_are_counted_by_reason_and_named_while_nothing_is_readable() -> None:
    watched = monitor()
    watched.port_changed(None, 0)
    watched.heard_bytes += 90
    for reason in ("checksum", "checksum", "range"):
        watched.reject(reason)
    health = report(watched, 1)
    assert health.rejected == {"checksum": 2, "range": 1}
    assert health.reason is not None
    assert health.reason.startswith("90 bytes came, no line of this sensor, 3 bad ones")


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
    for k in range(30):  # three sentences a second, one fix a second
        watched.accept(k * NS_PER_S // 3, False)
    for k in range(10):
        watched.measured(k * NS_PER_S)
    assert report(watched, 9.5).rate_hz == 1.0
