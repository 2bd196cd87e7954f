from dataclasses import dataclass, field

from common.boat_config import PortTable, SensorTable
from common.events import event
from common.framer import Measurement
from common.messages import Event, Heading
from common.units import NS_PER_S
from onboard.reading.byte_budget import ByteBudget
from onboard.reading.line_quality import Wire
from onboard.reading.port_chain import PortChain
from onboard.reading.sensor_health import SensorMonitor
from tests.acquire.sentences import sealed

HEADING = b"$HCHDG,101.1,,,,*43\r\n"


@dataclass
class Heard:
    """A sink that keeps what it is given."""

    measurements: list[tuple[Measurement, int]] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)

    def take(self, measurement: Measurement, now_ns: int) -> None:
        self.measurements.append((measurement, now_ns))

    def happened(self, happening: Event) -> None:
        self.events.append(happening)


def chain_with(sink: Heard, *sensors: str, bytes_per_s: int = 10_000) -> PortChain:
    wire = Wire()
    tables = [SensorTable(id=sensor, port="p", role=sensor[:-1]) for sensor in sensors]
    monitors = [SensorMonitor(table, 0, wire) for table in tables]
    return PortChain(PortTable(name="p", path="/dev/none"), ByteBudget(bytes_per_s), monitors, wire, sink)


def test_a_port_alone_gives_its_sink_measurements_with_the_time_of_their_chunk() -> None:
    sink = Heard()
    chain = chain_with(sink, "compass1")
    chain.changed(None, 0)
    chain.chunk(b"\r\n" + HEADING, 5)
    ((heading, t_ns),) = sink.measurements
    assert isinstance(heading, Heading)
    assert (heading.sensor, t_ns) == ("compass1", 5)
    assert chain.monitors["compass1"].accepted == 1


def test_every_loss_and_every_return_of_a_port_is_one_event_with_its_time() -> None:
    sink = Heard()
    chain = chain_with(sink)
    for reason, t_ns in (("no such device", 1), ("busy", 2), (None, 3), ("the device is gone", 4), ("busy", 5)):
        chain.changed(reason, t_ns)
    assert sink.events == [
        event("port-missing", 1, "p", port="p", reason="no such device"),
        event("port-opened", 3, "p", port="p", path="/dev/none"),
        event("port-lost", 4, "p", port="p", reason="the device is gone"),
    ]


def test_a_flood_begins_with_the_first_byte_over_the_budget_and_ends_when_the_bucket_is_nearly_full() -> None:
    sink = Heard()
    chain = chain_with(sink, "compass1", bytes_per_s=5000)
    chain.changed(None, 0)
    chain.chunk(b"x" * 5000, 1)
    assert not chain.wire.flooded
    chain.chunk(b"x", 2)
    assert chain.wire.flooded
    for tenth in range(1, 60):
        chain.flush(tenth * NS_PER_S // 10)
    codes = [(item.code, item.evidence) for item in sink.events if item.code.startswith("port-")][1:]
    assert codes == [("port-flooded", {"port": "p", "budget": 5000}), ("port-calm", {"port": "p", "budget": 5000})]
    assert not chain.wire.flooded


def test_a_receiver_that_gives_the_place_zero_is_named_once() -> None:
    sink = Heard()
    chain = chain_with(sink, "gps1")
    chain.changed(None, 0)
    for t_ns in (5, 6):
        chain.chunk(sealed("GPRMC,120000,A,0000.0000,N,00000.0000,E,0.0,0.0,010126,,,A") + b"\r\n", t_ns)
    assert [one for one in sink.events if one.code == "place-zero"] == [
        event("place-zero", 5, "gps1", sensor="gps1"),
    ]
    assert chain.monitors["gps1"].rejected == {"zero-position": 2}
    assert chain.wire.damaged == 0
