"""Frames of the `emulator`: 256 places of two bytes, the delay in 1/256 turn, then 0..255 linear in pressure."""

from ...wire_layout import Layout, linear_levels

LAYOUT = Layout(turn=256, delay_at=slice(0, 512, 2), levels=linear_levels(255), level_at=slice(1, 512, 2))
