"""Observers of a run: log, status line, events for a person, scores. A source hands each of them every step, once."""
