"""Bytes to a board: USB and serial ports, and how they are found."""
