"""The niceness of a process whose tests burn a core: it leaves ten parts in eleven to whatever else wants to run.

So what judges processor time or delays can run beside it. Where the kernel groups processes by session (autogroup),
their niceness counts within a session only, and our tests start each program in a session of its own: so this process
takes a session too, whose niceness counts between sessions. The class SCHED_IDLE would leave more, but then tests of
ports that wait for a moment wait too long.
"""

import os
from contextlib import suppress
from pathlib import Path

NICENESS = 10


def to_all() -> None:
    """The calling process, and what it starts, give way from now on; call it in no leader of a process group."""
    os.nice(NICENESS)
    os.setsid()
    with suppress(OSError):  # a kernel without autogroups
        Path("/proc/self/autogroup").write_text(str(NICENESS), encoding="ascii")
