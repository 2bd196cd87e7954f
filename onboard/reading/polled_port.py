"""Polling shell of a serial port: it feeds a pure `PortChain` by the boat clock."""

from common.clock import BoatClock
from onboard.reading.port_chain import PortChain
from onboard.reading.ports import Port


class PolledPort:
    """One port for as long as the daemon lives."""

    def __init__(self, chain: PortChain, clock: BoatClock) -> None:
        self.chain = chain
        self.port = Port(chain.table, clock, chain.chunk, self._changed)
        self._clock = clock

    def tick(self, now_ns: int) -> None:
        """Do what is due by the clock; a port whose sensors are all silent is opened once more."""
        self.chain.flush(now_ns)
        if self.chain.silent(now_ns):
            self.reopen()

    def reopen(self) -> None:
        """Close and open the port."""
        self.chain.reopening(self._clock.now_ns())
        self.port.reopen()

    def _changed(self, reason: str | None) -> None:
        self.chain.changed(reason, self._clock.now_ns())
