"""Pictures and reports made after a run."""
