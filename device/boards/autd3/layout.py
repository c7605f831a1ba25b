"""Frames of an AUTD3: 249 delays in 1/256 turn, then 249 amplitudes, 0..255 linear in pressure by its own table."""

from ...wire_layout import Layout, linear_levels

LAYOUT = Layout(turn=256, delay_at=slice(0, 249), levels=linear_levels(255), level_at=slice(249, 498))
