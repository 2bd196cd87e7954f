"""MCAP files that may be cut or damaged anywhere: what is sound is read, what is lost is named."""
