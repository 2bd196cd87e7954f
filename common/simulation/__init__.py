"""Simulated worlds: scenarios, truth, sensors with their flaws, and recordings played as a boat."""
