"""Recordings of serial ports (NMEA logs): played on the time inside their sentences, or converted to frames."""
