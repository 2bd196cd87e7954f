"""Trust in each sensor (fault detection and weighting): what its own scatter, and the other sensors, say of it."""
