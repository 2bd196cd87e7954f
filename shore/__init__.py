"""The station ashore: receives frames, filters, shows, logs, replays."""
