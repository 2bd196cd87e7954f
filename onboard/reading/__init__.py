"""Data acquisition: serial ports in, frames out; what arrives, when it was measured, and how each sensor delivers."""
