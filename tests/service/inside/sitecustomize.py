"""SIGUSR1 makes the daemon's loop hang: loaded by the test's drop-in only."""

import signal
import time

signal.signal(signal.SIGUSR1, lambda *_: time.sleep(600))
