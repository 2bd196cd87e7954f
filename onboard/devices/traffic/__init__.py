"""Traffic sensors: AIS receivers and radar target trackers."""
