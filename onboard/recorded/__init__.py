"""Recordings of serial ports: played on the time inside their sentences, or converted into a frames file."""
