"""The scheduling class (SCHED_IDLE) of a process whose tests burn a core: it runs only while no other wants to.

Beside such a process the tests that judge processor time or delays run as if alone. Where the kernel groups processes
by session (autogroup), the classes count within a session only, and our tests start each program in a session of its
own. So this process takes a session of its own too, and asks for the least share between sessions.
"""

import os
from contextlib import suppress
from pathlib import Path


def to_all() -> None:
    """The calling process, and what it starts, give way from now on; call it in no leader of a process group."""
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    os.setsid()
    with suppress(OSError):  # a kernel without autogroups
        Path("/proc/self/autogroup").write_text("19", encoding="ascii")
