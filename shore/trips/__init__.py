"""Logbook commands (`wayfix log`): the trips of a logbook, listed, verified, recovered and named."""
