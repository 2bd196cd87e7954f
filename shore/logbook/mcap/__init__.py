"""MCAP files that may be cut or damaged anywhere (error recovery): sound records are read, and losses are reported."""
