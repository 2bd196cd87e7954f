"""Reports: scores against a reference track (RMS error), and pictures of a trip."""
