"""Scores against a reference track, and pictures of a trip."""
