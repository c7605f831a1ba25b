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
    WARNINGS,
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
MINGW = "x86_64-w64-mingw32-g++"


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
def test_cmake_says_what_it_looked_for_and_where(tmp_path):
    code, text = configure(tmp_path)
    assert code != 0
    assert "Where is the SDK? Add -DULTRALEAP_SDK=/path/to/sdk" in text
    code, text = configure(tmp_path, tmp_path / "none")
    assert code != 0
    assert f"ULTRALEAP_SDK={tmp_path}/none is no folder" in text
    code, text = configure(tmp_path, tmp_path)
    assert code != 0
    assert (
        "neither ultraleap/haptics/streaming.hpp (SDK 3) nor UltrahapticsTimePointStreaming.hpp (SDK 2) is in" in text
    )
    assert f"{tmp_path}/include" in text
    sdk = make_sdk(tmp_path / "sdk", 3)
    code, text = configure(tmp_path, sdk)
    assert code != 0
    assert f"The headers of SDK 3 are in {sdk}/include, but its library, UltraleapHaptics" in text
    assert f"is in none of {sdk}/lib, {sdk}/lib64" in text
    (sdk / "lib").mkdir()
    (sdk / "lib" / "libUltrahaptics.so").write_bytes(b"")
    code, text = configure(tmp_path, sdk)
    assert code != 0
    assert f"The library of SDK 2 is there, {sdk}/lib/libUltrahaptics.so: two SDKs are mixed" in text


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("compiler", "version", "flags"),
    [("g++", 3, "-O2"), ("g++", 2, "-O2"), ("g++", 3, "-std=c++20"), ("clang++", 3, "-O2"), ("clang++", 2, "-O2")],
)
def test_compilers_warn_of_nothing(tmp_path, compiler, version, flags):
    assert compile_program(tmp_path, version, compiler, flags.split()).exists()


def test_sources_name_the_line_that_compiles_them():
    for version, library in LIBRARIES.items():
        text = (SOURCES / f"sdk{version}.cpp").read_text()
        assert (
            f'c++ -std=c++14 -O2 -I"$SDK/include" sdk{version}.cpp -o palpate-ultraleap -L"$SDK/lib" -l{library}'
            in text
        )


def test_nothing_but_the_two_files_names_the_vendors_library():
    for path in SOURCES.glob("*.hpp"):
        includes = re.findall(r"#include [<\"](.*)[>\"]", path.read_text())
        assert includes
        assert not [name for name in includes if "ultra" in name.lower()]


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
def test_it_runs_on_windows_as_wine_is(tmp_path):
    """The branch for Windows, with MinGW's compiler; tests by hand have run the others under Wine, too."""
    for tool in (MINGW, "wine"):
        if not shutil.which(tool):
            pytest.skip(f"{tool} is not installed")
    stub = STUBS / "sdk3"
    words = [MINGW, "-std=c++14", *WARNINGS, "-static", "-isystem", stub, SOURCES / "sdk3.cpp", stub / "stub.cpp"]
    done = subprocess.run([*words, "-o", tmp_path / "it.exe", "-lws2_32"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    sent = unlike_samples(2000, 2)
    (tmp_path / "points.bin").write_bytes(focus_file(sent, 20_000.0))
    done = play_file(["wine", tmp_path / "it.exe"], tmp_path, WINEPREFIX=str(tmp_path / "wine"), WINEDEBUG="-all")
    assert done.returncode == 0, done.stderr
    _, heard = recorded(tmp_path / "file", 2)
    assert compare(heard, sent) == (2000, 2000, 0, 0, 0, True, True)


@pytest.mark.exhaustive
def test_a_program_that_is_compiled_by_hand_plays_everything(tmp_path_factory, tmp_path):
    play_everything(shared_program(tmp_path_factory), tmp_path)
