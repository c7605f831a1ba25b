"""Drives have the same bits whichever kernels OpenBLAS and NumPy choose for a processor."""

import os
import subprocess
import sys

import pytest

# OpenBLAS takes the kernels of the processor named; NumPy leaves out instructions. Both ignore what is not there.
PROCESSORS = {
    "as-it-is": {},
    "SkylakeX": {"OPENBLAS_CORETYPE": "SkylakeX"},
    "Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "Zen": {"OPENBLAS_CORETYPE": "Zen"},
    "Nehalem": {"OPENBLAS_CORETYPE": "Nehalem", "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL X86_V3"},
    "Prescott": {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": "AVX512_SKX AVX512F FMA3 AVX2"},
}

DIGESTS = """
import hashlib
import numpy as np
from palpate.render.motions.explorations.control_points import dot, length_of
from palpate.device.registry import array_model
from palpate.render.playback.drive import Driver, DriveStrategy
from palpate.render.playback.drive import focus_delays
from palpate.render.sampling.metrics import FocalPoints

def print_digest(name, *arrays):
    print("bits of", name, *(hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest() for array in arrays))

rng = np.random.default_rng(3)
point = rng.uniform([-0.06, -0.06, 0.1], [0.06, 0.06, 0.25], (700, 3)).astype(np.float32)
for count in (1, 2, 249):
    place = rng.uniform(-0.1, 0.1, (count, 3)).astype(np.float32)
    print_digest(f"focus on {count}", focus_delays(point, place, 0.0086))
turned = array_model("pat16").placed([0.01, 0.02, 0.35, *(np.array([20.0, 2, 3, 4]) / np.sqrt(429))])
for arrays in ("emulator", turned):
    drives = Driver(arrays, DriveStrategy()).drive(FocalPoints(point, np.ones(700, np.float32)))
    print_digest(f"drives of {arrays if arrays == 'emulator' else 'a turned array'}", drives.delay, drives.amplitude)
foci = FocalPoints(point.reshape(175, 4, 3), np.ones((175, 4), np.float32))
print_digest("four foci", Driver("emulator").drive(foci).delay)
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
    assert len(digests["as-it-is"]) > 6
    for name, own in digests.items():
        assert own == digests["as-it-is"], name
