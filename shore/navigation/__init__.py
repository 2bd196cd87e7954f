"""State estimation: motion model, measurements, Kalman filters, and the order in which they are fused."""
