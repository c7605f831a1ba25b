"""Ctrl-C while a mesh becomes voxels: native code, which hears no signal, may be left within a second."""

import os
import signal
import subprocess
import sys
import time

import pytest

from palpate.render import MeshObject
from palpate.render.objects.voxels import voxeliser
from palpate.render.runtime import interrupt

NATIVE = {"auto": ("measure_distances", "cross_columns"), "winding": ("measure_distances", "wind_nodes")}


@pytest.mark.parametrize("sign", NATIVE)
def test_native_code_may_be_left_at_any_moment(sign, monkeypatch):
    """`interrupt.ended_promptly` ends the process while such work is under way, which its own tests show."""
    left = []
    for name in NATIVE[sign]:
        compute = getattr(voxeliser, name)

        def watched(*arguments, name=name, compute=compute, **options):
            left.append((name, len(interrupt._abandonable)))
            return compute(*arguments, **options)

        monkeypatch.setattr(voxeliser, name, watched)
    voxeliser.voxelise(MeshObject.load("cube"), spacing=0.03, sign=sign, device="cpu")
    assert left == [(name, 1) for name in NATIVE[sign]]
    assert not interrupt._abandonable


@pytest.mark.exhaustive
def test_ctrl_c_ends_a_long_voxelisation_within_seconds_and_leaves_no_file(tmp_path):
    """The distances of this grid take one launch of 10 s and more, which no signal ends."""
    command = [sys.executable, "-m", "palpate.render.cli", "voxelise", "dog-detailed", "-o", "dog.npz"]
    process = subprocess.Popen(
        [*command, "--spacing", "0.0003", "--device", "cpu"], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    time.sleep(6.0)  # by then it measures, or its kernels are compiled, which ends as promptly
    assert process.poll() is None
    os.kill(process.pid, signal.SIGINT)
    begun = time.monotonic()
    errors = process.communicate(timeout=60)[1]
    assert time.monotonic() - begun < interrupt.GRACE_SECONDS + 2.0
    assert process.returncode == 1
    assert "interrupted" in errors
    assert not list(tmp_path.iterdir())
