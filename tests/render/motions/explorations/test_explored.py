"""Explorations made on a device: the same bits whole, in parts, in any company, on any processor, and as ever."""

import hashlib
import itertools
import os
import subprocess
import sys

import numpy as np
import pytest

from palpate.kernels.motions import over_array
from palpate.render import ExploredPoses, HandMotion, MeshObject, exploration
from palpate.render.motions.explorations.explored import HostPoses, explored_rows, joined_rows

BOUNDS = np.array([[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]])
ARGUMENTS = [
    {"bounds": "tube", "seed": 3},
    {"bounds": "cube", "seed": 4, "duration": 61.0, "rate": 77.7},
    {"bounds": [[-0.1, -0.1, 0.0], [0.1, 0.1, 0.03]], "seed": 2**40, "duration": 0.01},
    {"bounds": "dog", "seed": 0, "rate": 1000.0, "duration": 2.0},
]
GOLDEN = {
    "over-array": "6343aae115a64dd702793e75d6f57f61f18f04eb08d8731949557a736fe166e4",
    "around": "dbcb9c876851ab013a9d10a797cb82953d3c3335a6828646a3d020afd74d573d",
}
# NumPy leaves out instructions that are there, and so does the C library; LLVM compiles kernels for another processor.
PROCESSORS = {
    "as it is": {},
    "without AVX-512": {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL"},
    "without AVX2": {
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL X86_V3",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA,-FMA4,-AVX",
        "OPENBLAS_CORETYPE": "Nehalem",
        "KERNELS_FOR": "x86-64",
    },
    "AVX2 and fused products": {"KERNELS_FOR": "x86-64-v3"},
}
DIGESTS = """
import hashlib, os
import warp
from palpate.kernels import patch
if "KERNELS_FOR" in os.environ:
    warp.config.use_precompiled_headers = False  # they are for the processor that it is
    for options in (patch.EXACT, patch.SELDOM):
        options["cpu_compiler_flags"] = "-target-cpu " + os.environ["KERNELS_FOR"]
from palpate.render import ExploredPoses
from palpate.render.motions.explorations.explored import explored_rows
for model in ("over-array", "around"):
    motions = [ExploredPoses.of("tube", seed=seed, model=model, duration=300.0) for seed in range(20)]
    rows = explored_rows([(own, 0, own.count) for own in motions], "cpu").numpy()
    print("digest of", model, hashlib.sha256(rows.tobytes()).hexdigest())
"""


def made():
    """Poses to be made, and those of `exploration`."""
    motions = [ExploredPoses.of(**own, model="around") for own in ARGUMENTS]
    return motions, [exploration(**own, model="around").pose for own in ARGUMENTS]


@pytest.mark.parametrize("model", GOLDEN)
def test_poses_are_the_bits_that_they_always_were(model, device):
    """Of version 1 of each model."""
    explorer = {"explorer": 3} if model == "over-array" else {}
    poses = ExploredPoses.of(BOUNDS, duration=20.0, rate=90.0, seed=7, model=model, **explorer)
    rows = poses.rows(0, 1800, device).numpy()
    assert hashlib.sha256(rows.tobytes()).hexdigest() == GOLDEN[model]
    np.testing.assert_array_equal(poses.motion.pose, rows)


def test_poses_are_those_of_exploration(device):
    motions, wanted = made()
    together = joined_rows([(own, 0, own.count) for own in motions], device)
    np.testing.assert_array_equal(together.numpy(), np.concatenate(wanted))
    for own, pose, given in zip(motions, wanted, ARGUMENTS, strict=True):
        np.testing.assert_array_equal(own.motion.pose, pose)
        np.testing.assert_array_equal(own.time, exploration(**given, model="around").time)


def test_parts_are_those_of_the_whole(device):
    motions, wanted = made()
    bounds = [0, 1, 700, 701, 2699, 2700]
    parts = [joined_rows([(motions[0], *pair)], device).numpy() for pair in itertools.pairwise(bounds)]
    np.testing.assert_array_equal(np.concatenate(parts), wanted[0])
    mixed = joined_rows([(motions[1], 5, 900), (motions[3], 0, 2000), (motions[1], 900, 901)], device)
    np.testing.assert_array_equal(mixed.numpy(), np.concatenate([wanted[1][5:900], wanted[3], wanted[1][900:901]]))


def test_models_and_poses_of_the_host_may_be_mixed(device):
    motions, wanted = made()
    over = ExploredPoses.of("tube", duration=1.0, explorer=6)
    ranges = [(motions[3], 0, 2000), (over, 0, 90), (HostPoses(over.motion), 3, 5), (motions[0], 0, 10)]
    rows = joined_rows(ranges, device).numpy()
    np.testing.assert_array_equal(
        rows, np.concatenate([wanted[3], over.motion.pose, over.motion.pose[3:5], wanted[0][:10]])
    )
    assert repr(motions[1]) == "ExploredPoses(4740 poses at 77.7 Hz, around, seed 4)"
    assert repr(over) == "ExploredPoses(90 poses at 90 Hz, person 6, seed 1)"


def test_a_long_motion_is_made_block_by_block_and_reported(monkeypatch):
    whole = exploration(BOUNDS, 5.0, seed=2)
    monkeypatch.setattr(over_array, "POSES_A_REPORT", 200)
    reports = []
    blocks = exploration(BOUNDS, 5.0, seed=2, progress=lambda *report: reports.append(report))
    np.testing.assert_array_equal(blocks.pose, whole.pose)
    np.testing.assert_array_equal(blocks.time, np.arange(450) / 90.0)
    assert reports == [(200, 450), (400, 450), (450, 450)]


def test_what_made_a_motion_stands_in_it_and_in_its_file(tmp_path):
    motion = exploration(BOUNDS, 0.5, explorer=6, seed=3, facing=0.8)
    made = {"model": "over-array", "version": 1, "duration": 0.5, "rate": 90.0, "seed": 3, "explorer": 6, "facing": 0.8}
    assert motion.provenance == made | {"workspace": [[-0.125, -0.125, 0.135], [0.125, 0.125, 0.325]]}
    assert (motion.seed, motion.offset, motion.inserted) == (3, 0.0, 0)
    assert HandMotion.load(motion.save(tmp_path / "own.h5")).provenance == motion.provenance
    around = exploration(BOUNDS, 1, model="around").provenance
    assert around == {"model": "around", "version": 1, "duration": 1.0, "rate": 90.0, "seed": 1}
    assert motion[0:3].provenance is None


@pytest.mark.exhaustive
def test_a_script_that_explores_first_reads_nothing_of_warp():
    """And one that only counts does not import it."""
    code = (
        "import sys; from palpate.render import ExploredPoses; print(ExploredPoses.of('tube').count, 'warp' in "
        "sys.modules); from palpate.render import exploration; exploration('tube', 0.1)"
    )
    done = subprocess.run([sys.executable, "-P", "-c", code], check=True, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("2700 False\n", "")


@pytest.mark.exhaustive
def test_poses_have_the_same_bits_on_every_kind_of_processor():
    digests = {}
    for name, own in PROCESSORS.items():
        words = [sys.executable, "-P", "-W", "ignore", "-c", DIGESTS]
        done = subprocess.run(words, env={**os.environ, **own}, check=True, capture_output=True, text=True)
        digests[name] = [line for line in done.stdout.splitlines() if line.startswith("digest of")]
    assert len(digests["as it is"]) == 2
    for name, own in digests.items():
        assert own == digests["as it is"], name


@pytest.mark.exhaustive
def test_every_bit_of_a_million_poses(device):
    """Of many motions made together, and each alone on the CPU."""
    tube = MeshObject.load("tube")
    motions = [ExploredPoses.of(tube, duration=300.0, seed=seed, model="around") for seed in range(40)]
    rows = explored_rows([(own, 0, own.count) for own in motions], device).numpy()
    np.testing.assert_array_equal(rows, np.concatenate([own.motion.pose for own in motions]))
