"""Truth and error models: what the virtual boat plays and what the laboratory measures filters with."""
