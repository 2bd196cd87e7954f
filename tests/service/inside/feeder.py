"""A compass on a pseudo-terminal that belongs to whom a serial port belongs: root:dialout, 0660."""

import grp
import os
import pty
import time
import tty
from contextlib import suppress
from pathlib import Path

master, slave = pty.openpty()
tty.setraw(slave)
port = Path(os.ttyname(slave))
os.chown(port, 0, grp.getgrnam("dialout").gr_gid)
port.chmod(0o660)
link = Path("/run/feeder/compass")
link.parent.mkdir(exist_ok=True)
link.unlink(missing_ok=True)
link.symlink_to(port)
os.set_blocking(master, False)
while True:
    with suppress(BlockingIOError):
        os.write(master, b"$HCHDG,123.4,,,,*46\r\n")
    time.sleep(0.1)
