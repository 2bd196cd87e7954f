"""`wayfix lab`: Monte Carlo runs of the filters in simulated worlds, beside the thesis' tables."""
