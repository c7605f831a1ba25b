"""All formats that the fuzzer knows, and how an input of one is made and damaged."""

import contextlib
import io
import warnings
from pathlib import Path
from typing import Any

import fuzz_commands as commands
import fuzz_described as described
import fuzz_stored as stored
from fuzz_format import Format
from fuzz_hdf5 import damage_hdf5
from fuzz_mutations import damage, damaged_bytes, flip_bits

FORMATS: tuple[Format, ...] = (
    Format("contours", stored.contour_seeds, stored.read_contours, is_checked=True, damage=damage_hdf5),
    Format("partial", stored.partial_seeds, stored.resume, is_checked=True, mutable=("*.log", "*.rows", "header.h5")),
    Format("motion-csv", stored.csv_seeds, stored.read_motion),
    Format("motion-hdf5", stored.hdf5_seeds, stored.read_motion, damage=damage_hdf5),
    Format("recording", stored.recording_seeds, stored.read_recording),
    Format("alignment", stored.alignment_seeds, stored.read_alignment),
    Format("table", stored.table_seeds, stored.read_table, damage=stored.damage_table),
    Format("old-poses", stored.old_seeds, stored.read_table, damage=damage_hdf5),
    Format("shard", stored.shard_seeds, stored.read_a_shard, is_checked=True, damage=damage_hdf5),
    Format(
        "store",
        stored.store_seeds,
        stored.read_store,
        is_checked=True,
        mutable=("store.sqlite", "*.h5"),
        damage=stored.damage_store,
    ),
    Format("frames", stored.frame_seeds, stored.read_frames, is_checked=True, damage=damage_hdf5),
    Format("mesh", described.mesh_seeds, described.read_mesh),
    Format("mesh-hand", described.hand_seeds, described.read_hand),
    Format("mesh-cache", described.cache_seeds, described.read_cache, is_checked=True),
    Format("volume", described.volume_seeds, described.read_volume),
    Format("expression", described.expression_seeds, described.read_expression),
    Format("strategy", described.strategy_seeds, described.read_strategy),
    Format("sampling", described.sampling_seeds, described.read_sampling),
    Format("descriptions", described.text_seeds, described.read_texts),
    Format("plan", described.plan_seeds, described.read_plan),
    Format("board", described.board_seeds, described.read_rig),
    Format("ptlist", described.ptlist_seeds, described.read_points),
    Format("palpate check", stored.contour_seeds, commands.run_check, damage=damage_hdf5),
    Format("palpate info", described.mesh_seeds, commands.run_info),
    Format("palpate play", commands.playable_seeds, commands.run_on_contours, damage=damage_hdf5),
    Format("palpate render", commands.rendered_seeds, commands.run_render),
    Format("palpate sweep", described.plan_seeds, commands.run_sweep),
    Format("palpate sampling", described.sampling_seeds, commands.run_sampling),
    Format("palpate devices", described.board_seeds, commands.run_devices),
)
"""What `--loader` names."""


def damage_seed(form: Format, path: Path, rng: Any) -> str:
    """Damage one file of a seed in place, by its format's way or by its suffix; sometimes more of its bytes."""
    if path.is_dir():
        files = sorted({own for pattern in form.mutable for own in path.rglob(pattern) if own.is_file()})
        if form.name == "palpate render":
            files = [own for own in files if own.stem == path.name] or files
        path = rng.choice(files)
    own_way = form.damage if path.suffix in (".h5", ".hdf5", ".parquet", ".sqlite") else None
    content = path.read_bytes()
    try:
        how = own_way(path, rng) if own_way is not None and rng.random() < 0.5 else damage(path, rng)
    except Exception:  # of readers and writers of others, where a change cannot be made: another one is
        path.write_bytes(flip_bits(content, rng))
        how = "bytes"
    for _ in range(rng.choice((0, 0, 0, 0, 1, 2))):
        path.write_bytes(damaged_bytes(path.read_bytes(), rng, is_text=False))
        how += " and bytes"
    return f"{path.name} {how}"


def make_seeds(form: Format, folder: Path) -> None:
    """Valid inputs of a format, each tried."""
    folder.mkdir(parents=True)
    with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
        warnings.simplefilter("ignore")
        form.seeds(folder)
