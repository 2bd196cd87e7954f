"""What tells of other ships: AIS and radar."""
