"""The station's end of the link: discovery, pairing, the session with the board, and which frames are missing."""
