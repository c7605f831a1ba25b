"""palpate-ultraleap compiles without a warning, by CMake and by hand, for Windows too; sanitizers find nothing."""

import os
import re
import shutil
import subprocess

import numpy as np
import pytest
from ultraleap_bridge import (
    SOURCES,
    STUBS,
    Bridge,
    Client,
    compare,
    compile_program,
    focus_file,
    recorded,
    shared_program,
    unlike_samples,
)

LIBRARIES = {3: "UltraleapHaptics", 2: "Ultrahaptics"}


def cmake(*words):
    if not shutil.which("cmake"):
        pytest.skip("cmake is not installed")
    done = subprocess.run(["cmake", *words], capture_output=True, text=True, check=False)
    return done.returncode, " ".join((done.stdout + done.stderr).split())  # CMake breaks lines


def configure(folder, sdk=None):
    words = [] if sdk is None else [f"-DULTRALEAP_SDK={sdk}"]
    return cmake("-S", str(SOURCES), "-B", str(folder / "build"), *words)


def make_sdk(folder, version, library=None, library_folder="lib"):
    """A folder as an SDK's, with a stub's headers, and its library under a name."""
    shutil.copytree(STUBS / f"sdk{version}", folder / "include", dirs_exist_ok=True)
    if library:
        (folder / library_folder).mkdir(parents=True, exist_ok=True)
        stub = STUBS / f"sdk{version}"
        words = ["g++", "-std=c++14", "-shared", "-fPIC", f"-I{stub}", stub / "stub.cpp", "-pthread"]
        subprocess.run([*words, "-o", folder / library_folder / f"lib{library}.so"], check=True)
    return folder


@pytest.mark.exhaustive
@pytest.mark.parametrize(("version", "library_folder"), [(3, "lib"), (2, "lib"), (3, "lib/x64"), (3, ".")])
def test_cmake_builds_against_an_sdk(tmp_path, version, library_folder):
    sdk = make_sdk(tmp_path / "sdk", version, LIBRARIES[version], library_folder)
    code, text = configure(tmp_path, sdk)
    assert code == 0, text
    assert f"SDK {version}: {sdk}/include, {sdk}/" in text
    code, text = cmake("--build", str(tmp_path / "build"))
    assert code == 0, text
    assert "warning" not in text
    program = tmp_path / "build" / "palpate-ultraleap"
    done = subprocess.run([program, "--list"], capture_output=True, text=True, check=True)
    assert re.fullmatch(r"USX:(USX-)?00000001\n", done.stdout)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("compiler", "version", "flags"),
    [("g++", 3, "-O2"), ("g++", 2, "-O2"), ("g++", 3, "-std=c++20"), ("clang++", 3, "-O2"), ("clang++", 2, "-O2")],
)
def test_compilers_warn_of_nothing(tmp_path, compiler, version, flags):
    assert compile_program(tmp_path, version, compiler, flags.split()).exists()


def play_everything(program, folder):
    """A client that plays, one that is refused, and a file: what was recorded is what was sent."""
    sent = unlike_samples(2000, 2)
    with Bridge(program, record=folder / "live") as bridge:
        with Client(bridge.port) as client:
            client.open(2, 20_000.0)
            client.wait(lambda state: state.device_samples > 0)
            client.play_out(sent)
            client.foci(sent)
            client.state(b"STOP")
            client.foci(np.full((1, 2, 4), 2.0))
            assert "intensity 2 is outside 0..1" in client.failure()
        assert bridge.end() == 0, bridge.output
    _, heard = recorded(folder / "live", 2)
    assert compare(heard, sent)[2] == 0
    (folder / "points.bin").write_bytes(focus_file(sent, 20_000.0))
    done = play_file([program], folder)
    assert done.returncode == 0, done.stderr
    _, heard = recorded(folder / "file", 2)
    assert compare(heard, sent) == (2000, 2000, 0, 0, 0, True, True)


def play_file(words, folder, **environment):
    environment = os.environ | {"STUB_RECORD": "file"} | environment
    words = [*words, "play", "points.bin"]
    return subprocess.run(words, env=environment, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.exhaustive
@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("kind", ["address,undefined", "thread"])
def test_sanitizers_find_nothing(tmp_path, kind, version):
    """They end the program with another exit code when they find something."""
    flags = [f"-fsanitize={kind}", "-fno-sanitize-recover=all", "-g"]
    program = compile_program(tmp_path, version, flags=flags)
    play_everything(program, tmp_path)


@pytest.mark.exhaustive
def test_a_program_that_is_compiled_by_hand_plays_everything(tmp_path_factory, tmp_path):
    play_everything(shared_program(tmp_path_factory), tmp_path)
