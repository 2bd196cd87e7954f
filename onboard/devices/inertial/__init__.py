"""Inertial measurement units (IMU) and rate gyros."""
