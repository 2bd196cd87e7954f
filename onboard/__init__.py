"""The daemon on the board: serial bytes in, timestamped frames out. Needs only what Debian ships for ARM."""
