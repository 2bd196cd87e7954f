"""Compasses."""
