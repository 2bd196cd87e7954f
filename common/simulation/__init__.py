"""Simulation: scenarios, ground truth, sensor error models, and recordings that are played as a boat."""
