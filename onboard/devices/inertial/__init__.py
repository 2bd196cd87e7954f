"""Inertial units and rate gyros."""
