"""Words for values in tables, and the units that stand after them; --json has the names."""

_NAMES = {
    "m": "length_longest jump_length jump_threshold step_longest height size spacing focal_width",
    "m, all poses": "length_mean length_object_mean length_hand_mean",
    "m, poses with contours": "length_mean_drawn",
    "m/s": "hop_speed_max",
    "s": """on_time duration elapsed seconds pose_seconds render_seconds starved silenced board_starved off_after
        absence_max latency_p50 latency_p99 latency_longest latency_recent_p50 latency_recent_p99 latency_recent_longest
        age_p50 age_p99 age_longest""",
    "s after the command began": "first_frame_seconds",
    "Hz": """draw_frequency_p05 draw_frequency_median draw_frequency_p95 draw_frequency_of_mean_length update_rate
        revisit_rate""",
    "Hz, mean while something is drawn": "draw_frequency",
    "Pa": "radiation_peak",
    "Pa, amplitude": "pressure_peak focus_pressure focus_pressure_least",
    "N": "force",
    "dB": "db_40_300 db_300_10k rms peak",
    "dB(A)": "dba",
    "focal points": "samples silent held",
    "of full drive": "duty",
    "of poses with contours": "facing_share_30 facing_share_60",
    "of the length, in a sample of poses": "fused_share",
}
UNITS = {name: unit for unit, names in _NAMES.items() for name in names.split()}
"""Units shown after values in tables, by name; for --json, docs/guide/command-line.md gives them."""

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
"""Words for values whose names alone are not clear."""


def words_of(name: str) -> str:
    """Words for a value in a table."""
    return WORDS.get(name, name.replace("_", " "))
