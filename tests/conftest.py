"""Devices to test on, kernels compiled once, hypothesis without clocks."""

import os
from pathlib import Path

import hypothesis
import numpy as np
import pytest
import warp as wp

wp.config.log_level = wp.LOG_WARNING

hypothesis.settings.register_profile("default", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "default")


def pytest_addoption(parser):
    parser.addoption(
        "--device", action="append", help="Warp device to test on (again for more); default: all there are"
    )


def pytest_configure(config):
    """Compile every kernel in this one process, before workers that would all do it at once."""
    if not hasattr(config, "workerinput"):
        from palpate.kernels import compile_kernels

        for device in config.getoption("--device") or [str(d) for d in wp.get_devices()]:
            compile_kernels(device)


def pytest_generate_tests(metafunc):
    if "device" in metafunc.fixturenames:
        metafunc.parametrize("device", metafunc.config.getoption("--device") or [str(d) for d in wp.get_devices()])


@pytest.fixture
def rng():
    return np.random.default_rng(20261121)


@pytest.fixture(scope="session")
def outside_data():
    """Folder of real recordings and meshes that are not part of the project."""
    folder = os.environ.get("PALPATE_TEST_DATA")
    if not folder:
        pytest.skip("PALPATE_TEST_DATA is not set: no real recordings and meshes to test with")
    if not Path(folder).is_dir():
        pytest.fail(f"PALPATE_TEST_DATA={folder} is not a folder")
    return Path(folder)
