"""GNSS receivers (GPS): one fix for each epoch."""
