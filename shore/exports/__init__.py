"""Track export (`wayfix export`): the track of a log for other programs."""
