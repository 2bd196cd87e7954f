"""The log of a session: raw frames in arrival order, with everything needed to run it again (docs/log-format.md)."""
