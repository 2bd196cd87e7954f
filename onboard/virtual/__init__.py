"""Simulator (virtual boat): pseudo-terminals that behave like the sensors of a real one."""
