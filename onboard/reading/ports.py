"""Serial port I/O, the only importer of pyserial: opens, reads, stamps once per chunk, reopens with backoff.

    opening --ok--> open --EOF or error--> lost --0.25 s, doubling to 2 s--> opening

A vanished adapter stays readable for ever, so its reader is removed before anything else is done.
Opening runs in a thread of its own with a deadline: a driver may block in it.
"""

import asyncio
import contextlib
import errno
import fcntl
import logging
import os
import select
import termios
import threading
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import serial

from common.boat_config import PortTable
from common.clock import BoatClock
from onboard.reading.port_access import why_absent, why_busy, why_denied

log = logging.getLogger(__name__)

READ_BYTES: Final = 4096
OPEN_DEADLINE_S: Final = 5.0
FIRST_BACK_OFF_S: Final = 0.25
LAST_BACK_OFF_S: Final = 2.0

_REASONS: Final = {
    errno.ENOENT: "no such device",
    errno.EACCES: "permission denied",
    errno.EPERM: "permission denied",
    errno.EBUSY: "busy; another program holds it",
    errno.EAGAIN: "busy; another program holds it",
    errno.EIO: "the device is gone",
    errno.ENXIO: "the device is gone",
    errno.ENOTTY: "not a serial port",
    errno.EINVAL: "not a serial port",
}


def reason_of(error: BaseException) -> str:
    """Words for a failed open or read."""
    number = _number(error) or _number(error.__context__)  # pyserial wraps termios' errors and drops their number
    if number in _REASONS:
        return _REASONS[number]
    return os.strerror(number) if number else str(error)


def reason_at(path: str, error: BaseException) -> str:
    """Words for a failed open of this path, with its cause and what to do. It looks through /proc: not for the loop."""
    number = _number(error) or _number(error.__context__)
    if number in (errno.EACCES, errno.EPERM):
        return why_denied(path, number)
    if number in (errno.EBUSY, errno.EAGAIN):
        return why_busy(path)
    return why_absent(path) if number == errno.ENOENT else reason_of(error)


def _number(error: BaseException | None) -> int | None:
    number = getattr(error, "errno", None)
    if number is None and error is not None and error.args and isinstance(error.args[0], int):
        number = error.args[0]  # termios.error is no OSError and keeps its number in args
    return number


def open_serial(table: PortTable) -> Any:
    """Open a port raw, non-blocking, exclusive, old bytes thrown away; raises OSError, ValueError or termios.error.

    pyserial's lock is advisory (flock): gpsd or ModemManager do not ask for it and would take every other byte.
    TIOCEXCL makes their opening fail, unless they run as root; who reads already is not stopped by either.
    """
    device = serial.Serial(table.path, table.baud, timeout=0, exclusive=True)
    if not os.path.realpath(table.path).startswith("/dev/pts/"):  # its other end would keep the mark of a killed daemon
        _share(device, alone=True)
    device.reset_input_buffer()
    return device


def _share(device: Any, *, alone: bool) -> None:
    with contextlib.suppress(OSError, termios.error):
        fcntl.ioctl(device.fileno(), termios.TIOCEXCL if alone else termios.TIOCNXCL)


OPEN_ERRORS: Final = (OSError, ValueError, termios.error)  # SerialException is an OSError


def read_serial(device: Any) -> bytes | None:
    """What an open port has, may be nothing; `None` = the device is gone. Raises OSError."""
    try:
        data = os.read(device.fileno(), READ_BYTES)
    except BlockingIOError:
        return b""
    # pyserial sets VMIN = 0: a second reader that was faster leaves an empty read too, which is no loss.
    return None if not data and _hung_up(device.fileno()) else data


class Port:
    """One serial port for as long as the daemon lives; `reason` is None while it is open."""

    def __init__(
        self,
        table: PortTable,
        clock: BoatClock,
        on_chunk: Callable[[bytes, int], None],
        on_change: Callable[[str | None], None],
    ) -> None:
        """on_chunk(bytes, t_ns) for each read; on_change(reason) when the port opens (None) or is lost."""
        self.table = table
        self.reason: str | None = "not opened yet"
        self._clock = clock
        self._on_chunk = on_chunk
        self._on_change = on_change
        self._device: Any = None
        self._opening: asyncio.Future[Any] | None = None
        self._lost = asyncio.Event()
        self.tried = asyncio.Event()
        """Set once the first attempt to open has ended, either way."""

    async def run(self) -> None:
        """Keep the port open until cancelled."""
        back_off_s = FIRST_BACK_OFF_S
        try:
            while True:
                opened = await self._open()
                self.tried.set()
                if opened:
                    opened_ns = self._clock.now_ns()
                    await self._lost.wait()
                    await _in_thread(self._close)
                    if self._clock.now_ns() - opened_ns > LAST_BACK_OFF_S * 1e9:
                        back_off_s = FIRST_BACK_OFF_S
                await asyncio.sleep(back_off_s / self._clock.rate)
                back_off_s = min(2 * back_off_s, LAST_BACK_OFF_S)
        finally:
            self._stop_reading()
            self._close()

    def reopen(self) -> None:
        """Close and open a silent port again. No change is reported: only a failure to open it would be one."""
        if self._device is not None:
            log.debug("%s is silent: %s is opened anew", self.table.name, self.table.path)
            self._stop_reading()
            self._lost.set()

    async def _open(self) -> bool:
        """One attempt. An open that hangs in its driver is waited for again, not started twice."""
        if self._opening is None:
            self._opening = _in_thread(partial(open_serial, self.table))
        opening = self._opening
        try:
            self._device = await asyncio.wait_for(asyncio.shield(opening), OPEN_DEADLINE_S)
        except OPEN_ERRORS as error:
            if not opening.done():  # the deadline; a TimeoutError is an OSError too
                self._set_reason(f"opening takes longer than {OPEN_DEADLINE_S:g} s")
                return False
            self._opening = None
            self._set_reason(await _in_thread(partial(reason_at, self.table.path, error)))
            return False
        self._opening = None
        self._lost.clear()
        asyncio.get_running_loop().add_reader(self._device.fileno(), self._readable)
        self._set_reason(None)
        return True

    def _readable(self) -> None:
        try:
            data = read_serial(self._device)
        except OSError as error:
            self._fail(reason_of(error))
            return
        if data is None:
            self._fail("the device is gone")
        elif data:
            self._on_chunk(data, self._clock.now_ns())

    def _fail(self, reason: str) -> None:
        self._stop_reading()
        self._set_reason(reason)
        self._lost.set()

    def _stop_reading(self) -> None:
        if self._device is not None and self._device.is_open:
            asyncio.get_running_loop().remove_reader(self._device.fileno())

    def _close(self) -> None:
        device, self._device = self._device, None
        if device is not None:
            _share(device, alone=False)  # or we could not open it again while another program has it open
            with contextlib.suppress(*OPEN_ERRORS):
                device.close()

    def _set_reason(self, reason: str | None) -> None:
        if reason != self.reason:
            self.reason = reason
            self._on_change(reason)


def _hung_up(descriptor: int) -> bool:
    watch = select.poll()
    watch.register(descriptor, 0)  # POLLHUP and POLLERR are always reported
    return bool(watch.poll(0))


def _in_thread(call: Callable[[], Any]) -> "asyncio.Future[Any]":
    """Run a call that may hang in a driver in a thread of its own, for which the daemon's end does not wait."""
    loop = asyncio.get_running_loop()
    future: asyncio.Future[Any] = loop.create_future()

    def deliver(result: Any, error: BaseException | None) -> None:
        if future.cancelled():
            return
        if error is None:
            future.set_result(result)
        else:
            future.set_exception(error)

    def work() -> None:
        result, failure = None, None
        try:
            result = call()
        except BaseException as error:  # handed to the waiting task
            failure = error
        with contextlib.suppress(RuntimeError):  # the loop is closed: the daemon has ended meanwhile
            loop.call_soon_threadsafe(deliver, result, failure)

    threading.Thread(target=work, daemon=True).start()
    return future
