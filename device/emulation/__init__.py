"""Emulated USB buses and serial ports."""
