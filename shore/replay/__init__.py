"""Replay: a log through the very pipeline that ran live, compared with what was published then."""
