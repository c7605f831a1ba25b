"""Drives and wire bytes have the same bits whichever instructions LLVM, OpenBLAS and NumPy choose for a processor."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from palpate.device import array_model, array_names
from palpate.render import Driver, DriveStrategy, FocalPoints

# OpenBLAS takes the kernels of the processor named; NumPy leaves out instructions. Both ignore what is not there. LLVM
# compiles Warp's kernels for the oldest x86-64, for one with AVX2 and fused products, and for the processor that it is.
PROCESSORS = {
    "as-it-is": {},
    "Haswell": {"OPENBLAS_CORETYPE": "Haswell", "KERNELS_FOR": "x86-64-v3"},
    "Nehalem": {"OPENBLAS_CORETYPE": "Nehalem", "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL X86_V3"},
    "Prescott": {
        "OPENBLAS_CORETYPE": "Prescott",
        "NPY_DISABLE_CPU_FEATURES": "AVX512_SKX AVX512F FMA3 AVX2",
        "KERNELS_FOR": "x86-64",
    },
}

DIGESTS = """
import hashlib, os
import numpy as np
import warp
from palpate.kernels import patch
if "KERNELS_FOR" in os.environ:
    warp.config.use_precompiled_headers = False  # they are for the processor that it is
    for options in (patch.EXACT, patch.SELDOM):
        options["cpu_compiler_flags"] = "-target-cpu " + os.environ["KERNELS_FOR"]
from palpate.render.motions.explorations.control_points import dot, length_of
from palpate.device.registry import array_model
from palpate.render.playback.drive import Driver, DriveStrategy
from palpate.render.sampling.metrics import FocalPoints

def print_digest(name, *arrays):
    print("bits of", name, *(hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest() for array in arrays))

rng = np.random.default_rng(3)
point = rng.uniform([-0.06, -0.06, 0.1], [0.06, 0.06, 0.25], (700, 3)).astype(np.float32)
level = rng.random(700, np.float32)
turned = array_model("pat16").placed([0.01, 0.02, 0.35, *(np.array([20.0, 2, 3, 4]) / np.sqrt(429))])
foci = FocalPoints(point.reshape(175, 4, 3), level.reshape(175, 4))
slew = DriveStrategy(slew=0.01)
for arrays in ("emulator", turned, "autd3"):
    name = arrays if isinstance(arrays, str) else "a turned array"
    drives = Driver(arrays, DriveStrategy()).drive(FocalPoints(point, level))
    print_digest(f"drives of {name}", drives.delay)
    for label, focus, strategy in (
        ("one", FocalPoints(point, level), DriveStrategy()),
        ("four", foci, DriveStrategy(amplitude="force")),
        ("limited", FocalPoints(point, level), slew),
    ):
        driver = Driver(arrays, strategy, update_rate=10e3)
        print_digest(f"{label} of {name}", driver.pack(focus).frames[0].numpy())
print_digest("vectors", dot(rng.normal(size=(500, 3)), rng.normal(size=(500, 3))), length_of(rng.normal(size=(500, 4))))
"""


@pytest.mark.exhaustive
def test_drives_have_the_same_bits_on_every_kind_of_processor():
    digests = {}
    for name, own in PROCESSORS.items():
        environment = {key: value for key, value in os.environ.items() if key != "OPENBLAS_CORETYPE"} | own
        done = subprocess.run(
            [sys.executable, "-P", "-W", "ignore", "-c", DIGESTS],
            env=environment,
            check=True,
            capture_output=True,
            text=True,
        )
        lines = [line for line in done.stdout.splitlines() if line.startswith("bits of")]
        digests[name] = dict(line.rsplit(" ", 1) for line in lines)
    assert len(digests["as-it-is"]) > 12
    for name, own in digests.items():
        assert own == digests["as-it-is"], name


def digest_of(name, device, foci=1, **strategy):
    """SHA-256 of the wire bytes of focal points whose coordinates are whole tenths of millimetres."""
    number = np.arange(500 * foci)
    place = np.stack([number * 37 % 1001 - 500, number * 53 % 1201 - 600, 1000 + number * 71 % 2003], axis=-1)
    level = (number * 17 % 256).astype(np.float32) / np.float32(255)
    shape = (500,) if foci == 1 else (500, foci)
    focus = FocalPoints((place / 1e4).astype(np.float32).reshape(*shape, 3), level.reshape(shape))
    driver = Driver(array_model(name), DriveStrategy(**strategy), update_rate=10e3, device=device)
    return hashlib.sha256(driver.pack(focus).frames[0].numpy().tobytes()).hexdigest()[:16]


# Of a stratos nothing is summed or rooted: these are the bytes of float32 positions and of level k / 255.
ONE = {
    "emulator": "f6584d86dee9ab69",
    "pat16": "3c2327ad023d8536",
    "sonicsurface": "db21ba8107ccf93b",
    "autd3": "be18d66b8a2557e8",
    "stratos": "bf63406278557a42",
}


@pytest.mark.parametrize("name", array_names())
def test_bytes_of_one_focal_point_are_these_on_every_processor_and_gpu(name, device):
    assert digest_of(name, device) == ONE[name]


def test_bytes_of_several_and_of_a_slew_limit_are_these_on_every_processor():
    found = [digest_of("pat16", "cpu", foci=4), digest_of("pat16", "cpu", slew=0.01)]
    assert found == ["3582f7c105c75375", "f47ecbbd066752f8"]
