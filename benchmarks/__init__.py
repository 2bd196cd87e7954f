"""Measurements by hand: figures and how to get them stand in README.md."""
