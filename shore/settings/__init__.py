"""Settings of the station (configuration, preferences): `wayfix.toml`, and the command line that wins over it."""
