"""Recordings of serial ports: their lines, when each was sent, and which sensors speak in them."""
