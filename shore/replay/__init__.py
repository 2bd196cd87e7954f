"""Replay (`wayfix replay`): a log through the filters again, compared with the live run."""
