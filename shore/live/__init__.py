"""`wayfix connect`: a live session from the board's greeting to its end."""
