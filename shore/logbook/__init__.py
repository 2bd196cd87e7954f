"""Logs: MCAP files that are written while a run goes on and read whatever became of them."""
