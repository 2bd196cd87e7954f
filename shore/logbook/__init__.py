"""Logs (MCAP): files that are written while a run goes on, and that can be read even when they are cut or damaged."""
