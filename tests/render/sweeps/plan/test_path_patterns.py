"""Patterns of paths in plans; Python's own glob says what they match."""

import glob
import os

import pytest

from palpate.render.sweeps.plan import sources
from palpate.render.sweeps.plan.sources import match_files

FILES = ("a.stl", "b.obj", "m/c.stl", "m/n/d.stl", "m/n/e/f.stl", ".hidden/g.stl", "m/.h.stl", "other/n/d.stl")
PATTERNS = (
    *(
        "*.stl",
        "m/*.stl",
        "**/*.stl",
        "m/**/*.stl",
        "*/n/*.stl",
        "*/**/d.stl",
        "**",
        "m/**",
        "**/n/d.stl",
        "**/n/*.?tl",
    ),
    *("[ab].*", "nothing/**/*.stl", "./**/d.stl", "m/../**/c.stl"),
)


@pytest.fixture
def folder(tmp_path):
    for name in FILES:
        path = tmp_path / "plan" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
    return tmp_path / "plan"


def test_patterns_match_what_pythons_glob_matches(folder):
    for pattern in (*PATTERNS, *(f"{folder}/{pattern}" for pattern in PATTERNS)):
        listed = glob.glob(pattern, root_dir=folder, recursive=True)
        files = {os.path.normpath(text) for text in listed if (folder / text).is_file()}
        found = match_files(pattern, folder)
        assert {os.path.normpath(text) for text in found} == files, pattern
        assert found == sorted(found)


def test_a_pattern_that_would_walk_a_whole_disk_is_refused(folder, monkeypatch):
    monkeypatch.setattr(sources, "FOLDERS_MOST", 5)
    assert len(match_files("m/**/*.stl", folder)) == 3
    with pytest.raises(ValueError, match=r"'\*\*/\*.stl' looks into more than 5 folders below .*plan"):
        match_files("**/*.stl", folder)
    with pytest.raises(ValueError, match=r"'/\*\*/\*.stl' looks into more than 5 folders below /:"):
        match_files("/**/*.stl", folder)
    with pytest.raises(ValueError, match=r"may have \*\* once"):
        match_files("**/m/**/*.stl", folder)
