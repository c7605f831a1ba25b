"""What the fuzzer reads of what palpate and others store: contours, motions, recordings, sweeps, frames."""

import contextlib
import os
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_format import Refused, Wrong, refuse_far
from fuzz_hdf5 import damage_hdf5, damage_parquet, damage_sqlite

# contour files


def contour_seeds(folder: Path) -> None:
    from contour_cases import everything, make_contours, small_chunks, write_file

    write_file(folder / "plain.h5", make_contours(6))
    write_file(folder / "dwell.h5", make_contours(6, intensity=True, dwell=True), **everything(6))
    with small_chunks(7):
        write_file(folder / "chunks.h5", make_contours(40, intensity=True))
    write_file(folder / "large.h5", make_contours(3000, intensity=True, dwell=True), chunk=500)


def read_contours(path: Path) -> Any:
    """Everything of a contour file that `check` calls whole."""
    from palpate.datasets import ContourFile, check_file
    from palpate.datasets.errors import DatasetError

    with chunk_rows_of(path):
        problems = check_file(path)
        try:
            with ContourFile(path) as file:
                found = everything_of(file)
        except DatasetError as error:
            if not problems:
                raise Wrong(f"check says whole, reading says: {error}") from error
            raise
    if problems:
        raise Refused("; ".join(problems))
    return found


def everything_of(file: Any) -> dict[str, Any]:
    found = {**file.contours(), **file.metrics(), **file.motion(), **file.object(), **file.hand_arrays()}
    found |= {f"attribute {name}": value for name, value in file.attributes.items()}
    found |= {"strategy": file.strategy, "hand": file.hand, "recipe": file.recipe}
    timing = file.timing()
    return found | {f"timing {name}": value for name, value in zip(timing._fields, timing, strict=True)}


@contextlib.contextmanager
def chunk_rows_of(path: Path) -> Any:
    """The small chunks that a seed was written with."""
    from contour_cases import small_chunks

    with small_chunks(7) if "chunks" in str(path) else contextlib.nullcontext():
        yield


POSES, DONE = 40, (0, 9, 23)


def partial_seeds(folder: Path) -> None:
    """Work folders of interrupted renderings, and one whose file was sealed before it was removed."""
    from contour_cases import make_contours, make_header, small_chunks, write_ranges

    from palpate.datasets import ContourWriter

    for name, rows in (("chunks", 7), ("tails", 8192)):
        own = folder / name
        own.mkdir()
        with small_chunks(rows), ContourWriter(own / "out.h5", make_header(POSES)) as writer:
            write_ranges(writer, make_contours(POSES), [(DONE[0], DONE[1]), (DONE[1], DONE[2]), (30, 34)])


def resume(folder: Path) -> Any:
    """What a resumed rendering seals: the rows done, and those that are missing written again."""
    from contour_cases import make_contours, make_header, write_ranges

    from palpate.datasets import ContourFile, ContourWriter, check_file

    path = folder / "out.h5"
    with chunk_rows_of(folder):
        check_file(path.with_name(path.name + ".partial"))
        with ContourWriter(path, make_header(POSES), mode="resume") as writer:
            write_ranges(writer, make_contours(POSES), writer.missing())
            writer.seal()
        if problems := check_file(path):
            raise Wrong(f"sealed, and check says: {problems[0]}")
        with ContourFile(path) as file:
            return {**file.contours(), **file.metrics()}


# motions, recordings, alignments


def motion_seeds(folder: Path, suffix: str) -> None:
    from palpate.datasets import HandMotion, static_pose

    pose = np.repeat(static_pose([0, 0, 0.2]).pose, 12, axis=0)
    HandMotion(np.arange(12) / 90, pose, seed=3).save(folder / f"timed{suffix}")
    static_pose([0, 0, 0.2]).save(folder / f"static{suffix}")


def csv_seeds(folder: Path) -> None:
    motion_seeds(folder, ".csv")


def hdf5_seeds(folder: Path) -> None:
    motion_seeds(folder, ".h5")


def read_motion(path: Path) -> Any:
    from palpate.datasets import HandMotion

    motion = HandMotion.load(path)
    refuse_far(motion.pose[:, :3])
    return motion


def recording_seeds(folder: Path) -> None:
    from palpate.datasets.recordings.sample import write_sample

    for form in ("leap", "openxr", "webxr", "mediapipe"):
        for suffix in (".json", ".csv"):
            write_sample(form, folder / f"{form}{suffix}", frame_count=3)
    write_sample("leap", folder / "leap.npz", frame_count=3)
    write_sample("webxr-static", folder / "static.json")
    if data := os.environ.get("PALPATE_TEST_DATA"):
        (folder / "real.json").write_bytes((Path(data) / "hands" / "webxr_poses.json").read_bytes())


def read_recording(path: Path) -> Any:
    from palpate.datasets import load_recording

    motion = load_recording(path).motion()
    refuse_far(motion.pose[:, :3])
    return motion


def alignment_seeds(folder: Path) -> None:
    from palpate.datasets.recordings.alignment import write_alignment

    write_alignment(folder / "pose.json", [0, 0.1, 0, 0.70710678, 0, 0, 0.70710678])
    (folder / "matrix.json").write_text('{"matrix": [[1,0,0,0],[0,0,-1,0.12],[0,1,0,0],[0,0,0,1]]}')


def read_alignment(path: Path) -> Any:
    from palpate.datasets.recordings.alignment import alignment_pose

    pose = alignment_pose(path)
    refuse_far(pose[:3])
    return pose


# sweeps

MAKER = "palpate fuzz"
COLUMNS = {"pose": np.arange(300), "length": np.linspace(0, 1, 300, dtype=np.float32), "drawn": np.arange(300) % 3 > 0}


def table_seeds(folder: Path) -> None:
    from palpate.datasets.sweeps.table import write_parquet, write_table

    columns = {
        "recipe_hash": [f"h{k}" for k in range(20)],
        "object.source": ["cube", "tüb"] * 10,
        "length_mean": np.linspace(0, 1, 20),
        "poses": np.arange(20),
        "complete": np.arange(20) % 2 > 0,
    }
    attributes = {"maker": "me", "count": 20, "plan": {"object": ["cube"]}}
    write_table(folder / "table.h5", columns, attributes, units={"length_mean": "m"})
    write_parquet(folder / "table.parquet", columns, attributes, units={"length_mean": "m"})


def old_seeds(folder: Path) -> None:
    from old_pose_table import write_old_table

    write_old_table(folder / "poses.h5", COLUMNS, {"maker": "me"}, {"length": "m"})


def read_table(path: Path) -> Any:
    from palpate.datasets.sweeps.table import column_units, load_table, table_attributes
    from palpate.render.sweeps.report.compare import load_baseline

    found = load_table(path), table_attributes(path), column_units(path)
    if "recipe_hash" in found[0]:
        load_baseline(path)
    return found


def damage_table(path: Path, rng: Any) -> str:
    return damage_parquet(path, rng) if path.suffix == ".parquet" else damage_hdf5(path, rng)


def shard_rows() -> tuple[list[Any], list[Any]]:
    from palpate.datasets.sweeps.shard import ShardRow

    rows = [ShardRow("contours", "k", 0, {"poses": 3, "name": "ü"}), ShardRow("poses", "k", 1, {"stat": [1, 0.5]})]
    return rows, [None, COLUMNS]


def shard_seeds(folder: Path) -> None:
    from palpate.datasets.sweeps.shard import write_shard

    write_shard(folder / "a.h5", *shard_rows(), maker=MAKER)


def read_a_shard(path: Path) -> Any:
    from palpate.datasets.sweeps.shard import read_shard, shard_columns

    shard = read_shard(path)
    found = {"rows": [vars(row) for row in shard.rows], "columns": list(shard.columns)}
    with shard_columns(path) as reader:
        reader.columns(1, "poses", "k", 1)
    return found


def store_seeds(folder: Path) -> None:
    from palpate.datasets.sweeps.shard import ShardRow, write_shard
    from palpate.datasets.sweeps.store import SweepStore

    own = folder / "a.sweep"
    with SweepStore(own, maker=MAKER) as store:
        for number in range(4):
            rows = [ShardRow("poses", "k", number, {"poses": 300, "stat": {"length": [1.0, number]}, "name": "ü"})]
            write_shard(own / "shards" / f"{number}.h5", rows, [COLUMNS], maker=MAKER)
            store.record(f"shards/{number}.h5")
        rows = [ShardRow("contours", f"k{k}", 0, {"poses": k, "stat": {"length": [k / 7] * 5}}) for k in range(60)]
        write_shard(own / "shards" / "b.h5", rows, maker=MAKER)
        store.record("shards/b.h5")
        store.record_failure("r", "could not be made: ü")


def read_store(folder: Path) -> Any:
    """All that a store gives back; parts that it says are not done may be missing, and no others."""
    from palpate.datasets.sweeps.store import SweepStore

    keys = [("poses", "k"), *(("contours", f"k{k}") for k in range(60))]
    with SweepStore(folder, maker=MAKER) as store:
        store.recover()
        done = {place: sorted(parts) for place, parts in store.done(keys).items()}
        found = {"results": list(store.results(keys)), "failed": store.failed()}
        found["columns"] = list(store.column_parts("k"))
        if [part for part, _ in found["columns"]] != done["poses", "k"]:
            raise Wrong("parts are done whose columns are not there")
        found["done"] = done
        if store.damaged:
            raise Refused("; ".join(store.damaged))
    return found


def damage_store(path: Path, rng: Any) -> str:
    return damage_sqlite(path, rng) if path.suffix == ".sqlite" else damage_hdf5(path, rng)


def frame_seeds(folder: Path) -> None:
    from palpate.datasets.focus_files.frame_file import FrameField, FrameFile

    rng = np.random.default_rng(1)
    about = {"version": np.array([1, 0], np.int32), "recipe": '{"thing": {"name": "my thing"}}'}
    for name, form, group, fields, values, more in (
        ("points", "palpate focal points", "/focus",
         [FrameField("/focus/position", (3,), "m"), FrameField("/focus/intensity", (), "1")],
         (rng.uniform(0.1, 0.2, (50, 3)), rng.uniform(0, 1, 50)), {}),
        ("drives", "palpate drives", "/drive",
         [FrameField("/drive/delay", (256,), "turn"), FrameField("/drive/amplitude", (), "1")],
         (np.full((10, 256), 0.5), np.ones(10)), {"/array": {"names": '["emulator"]'}}),
    ):  # fmt: skip
        told = {"/": about | {"format": form}, group: {"update_rate": 5000.0}, **more}
        with FrameFile(folder / f"{name}.h5", fields, len(values[0]), attributes=told) as file:
            file.append({field.path: rows for field, rows in zip(fields, values, strict=True)})
            file.publish()


def read_frames(path: Path) -> Any:
    from palpate.datasets.focus_files.frame_reader import FOCAL_POINTS, FrameReader, check_frames

    problems = check_frames(path)
    with FrameReader(path) as file:
        found: dict[str, Any] = {"format": file.format, "rate": file.update_rate, "recipe": file.recipe()}
        if file.format == FOCAL_POINTS:
            found["position"], found["intensity"] = file.focal_points(0, file.frame_count)
    if problems:
        raise Refused("; ".join(problems))
    return found
