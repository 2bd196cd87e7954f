"""Live session (`wayfix connect`), from the board's greeting to its end."""
