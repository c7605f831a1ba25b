"""What tables call values, and the units that they show after them; --json has the names."""

UNITS = {
    "length_mean": "m, all poses",
    "length_mean_drawn": "m, poses with contours",
    "length_longest": "m",
    "length_object_mean": "m, all poses",
    "length_hand_mean": "m, all poses",
    "draw_frequency": "Hz, mean while something is drawn",
    "draw_frequency_p05": "Hz",
    "draw_frequency_median": "Hz",
    "draw_frequency_p95": "Hz",
    "draw_frequency_of_mean_length": "Hz",
    "fused_share": "of the length, in a sample of poses",
    "facing_share_30": "of poses with contours",
    "facing_share_60": "of poses with contours",
    "update_rate": "Hz",
    "revisit_rate": "Hz",
    "on_time": "s",
    "duration": "s",
    "elapsed": "s",
    "seconds": "s",
    **dict.fromkeys(
        [f"{name}_{which}" for name in ("latency", "latency_recent", "age") for which in ("p50", "p99", "longest")], "s"
    ),
    "pose_seconds": "s",
    "render_seconds": "s",
    "starved": "s",
    "silenced": "s",
    "off_after": "s",
    "first_frame_seconds": "s after the command began",
    "board_starved": "s",
    "jump_length": "m",
    "jump_threshold": "m",
    "step_longest": "m",
    "hop_speed_max": "m/s",
    "absence_max": "s",
    "height": "m",
    "size": "m",
    "spacing": "m",
    "pressure_peak": "Pa, amplitude",
    "radiation_peak": "Pa",
    "force": "N",
    "focal_width": "m",
    "focus_pressure": "Pa, amplitude",
    "focus_pressure_least": "Pa, amplitude",
    **dict.fromkeys(("db_40_300", "db_300_10k", "rms", "peak"), "dB"),
    "dba": "dB(A)",
    **dict.fromkeys(("samples", "silent", "held"), "focal points"),
    "duty": "of full drive",
}
"""Units shown after values in tables; for --json, docs/guide/command-line.md gives them."""

WORDS = {
    "r": "r = |CC| / |OC|",
    "fused_share": "nearer than a focal width",
    "db_40_300": "noise, 40 to 300 Hz",
    "db_300_10k": "noise, 300 Hz to 10 kHz",
    "dba": "noise, as an ear weighs it",
    "rms": "noise, whole",
    "peak": "noise, peak",
    "difference": "louder than the first by [dB]",
    "first_frame_seconds": "first frame",
    "starved": "without a new frame",
    "board_starved": "without a new frame, by the board",
    "held": "held where nothing is drawn",
    "silent": "with intensity 0",
    "samples": "sampled",
    "on_time": "longest emission",
    "refused": "silenced, out of reach",
    "absence_max": "longest absence from a place",
    "duty": "mean drive",
}
"""What tables call values whose name alone says too little; --json has the names."""


def words_of(name: str) -> str:
    """What a table calls a value."""
    return WORDS.get(name, name.replace("_", " "))
