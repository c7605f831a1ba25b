"""Emulated USB buses and serial ports, faults included."""
