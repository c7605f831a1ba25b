"""What every device must compute, as one .npz that a machine with Warp, NumPy and pytest alone can test against.

    PYTHONPATH=tests/oracles python tests/cases/device_numbers.py OUT.npz
    PALPATE_DEVICE_NUMBERS=OUT.npz pytest tests/kernels/test_device_numbers.py --device cuda:0 -m ''

By object (`tube/...`): `vertices` and `faces`; `poses`, `half` extents [m] of the palm; `degenerate`, the poses within
1 um of one that rounding decides; by strategy (`tube/cc/...`): `oracle`, lengths [m] in float64, NaN where there is no
oracle; by method (`tube/cc/trace/...`): what the CPU computes, the fields of `drawing.Drawn`, contours of the first
poses and lengths of all. `many/...`: one object at many poses made by `drawing.exact_poses`, checksums of lengths.
"""

import sys
import zlib
from dataclasses import fields

import numpy as np
from drawing import SEARCHES, STRATEGIES, Drawn, draw, exact_poses, patch_array, surface_on
from mesh_cases import CLOSED, MESHES, slab
from section_oracle import cut_mesh, is_degenerate, soup_length

HALF = np.array([0.0425, 0.03])  # [m]
UNBOUNDED = np.array([9.0, 9.0])  # [m]
KEPT = 12  # poses whose contours are kept
CHUNK = 50_000  # poses to a checksum
SEED_OF_MANY = 2


def objects(small):
    """Meshes by name; one too large for a trail where there is time for it."""
    if small:
        return {name: MESHES[name]() for name in ("cube", "tube", "comb", "torn dog")}
    waves = slab(lambda x, y: 0.01 * np.sin(x * 300) * np.cos(y * 200) + 0.02 * y, 90)
    return {name: make() for name, make in MESHES.items()} | {"waves": waves}


def oracle_lengths(name, mesh, poses, strategy):
    """Lengths in float64 [m], shape [pose]."""
    half = UNBOUNDED if strategy == "raw" else HALF
    if name in CLOSED or name == "waves":
        cuts = [cut_mesh(*mesh, pose, half) for pose in poses]
        return np.array([cut.cc_length if strategy == "cc" else cut.oc_length for cut in cuts])
    if strategy == "cc":
        return np.full(len(poses), np.nan)
    return np.array([soup_length(*mesh, pose, half) for pose in poses])


def numbers_of(name, mesh, poses):
    """All of an object, by key."""
    vertices, faces = mesh
    out = {"vertices": vertices, "faces": faces, "poses": poses, "half": HALF}
    out["degenerate"] = np.array([is_degenerate(vertices, faces, pose, HALF) for pose in poses])
    surface, patch = surface_on(mesh, "cpu"), patch_array(HALF, "cpu")
    for strategy in STRATEGIES:
        if strategy == "cc" and surface.is_open:
            continue
        out[f"{strategy}/oracle"] = oracle_lengths(name, mesh, poses, strategy)
        for method in SEARCHES if surface.scan_path.shape[0] > 0 else ("tree",):
            drawn = draw(surface, poses, patch, strategy, method)
            kept = drawn.part(0, KEPT)
            for field in fields(Drawn):
                out[f"{strategy}/{method}/{field.name}"] = getattr(
                    drawn if field.name == "length" else kept, field.name
                )
    return {f"{name}/{key}": value for key, value in out.items()}


def numbers_of_many(mesh, count):
    """Closed contours of an object at that many poses: CRC-32 and sum [m] of lengths, chunk by chunk of poses."""
    surface, patch = surface_on(mesh, "cpu"), patch_array(HALF, "cpu")
    length = draw(surface, exact_poses(count, SEED_OF_MANY), patch, "cc", None).length
    chunks = [np.ascontiguousarray(length[first : first + CHUNK]) for first in range(0, count, CHUNK)]
    out = {"vertices": mesh[0], "faces": mesh[1], "half": HALF}
    out |= {"count": np.array(count), "chunk": np.array(CHUNK), "seed": np.array(SEED_OF_MANY)}
    out["crc"] = np.array([zlib.crc32(chunk.tobytes()) for chunk in chunks], np.uint32)
    out["sum"] = np.array([chunk.sum(dtype=np.float64) for chunk in chunks])
    return {f"many/{key}": value for key, value in out.items()}


def make_numbers(path, *, small=False):
    """Write the .npz; small: seconds of work, few objects and poses."""
    out = numbers_of_many(MESHES["tube"](), 5_000 if small else 1_000_000)
    for name, mesh in objects(small).items():
        poses = exact_poses(20 if small else 300, 1)
        poses[1:KEPT:2, :3] = mesh[0][7 * np.arange(KEPT // 2) % len(mesh[0])]  # planes through vertices
        out |= numbers_of(name, mesh, poses)
    np.savez_compressed(path, **out)


if __name__ == "__main__":
    make_numbers(sys.argv[1])
