"""Compass drivers: heading, rate of turn, attitude."""
