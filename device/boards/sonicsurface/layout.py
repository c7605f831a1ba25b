"""Frames of a SonicSurface: 0xFE, 256 delays of 0..31 in 1/32 turn or 32 for off, 0xFD. A pulse is half a period."""

from ...wire_layout import Layout, linear_levels

LAYOUT = Layout(turn=32, delay_at=slice(1, 257), levels=linear_levels(1), fixed={0: 0xFE, 257: 0xFD})
