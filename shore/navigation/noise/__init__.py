"""Noise adaptation: rules that learn the measurement noise R, and the process noise Q, from innovations."""
