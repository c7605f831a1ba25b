"""What may be written: nothing that is there unasked, no folder, and never what the result is made from."""

import os

import pytest

from palpate.render import StrategyError
from palpate.render.output_file import require_output


def test_what_is_there_needs_to_be_asked_for_also_a_link_to_nothing(tmp_path):
    there, nowhere = tmp_path / "there", tmp_path / "nowhere"
    there.touch()
    nowhere.symlink_to(tmp_path / "missing")
    for out in (there, nowhere):
        with pytest.raises(StrategyError, match="exists"):
            require_output(out, overwrite=False)
        require_output(out, overwrite=True)
    require_output(tmp_path / "new", overwrite=False)


def test_folders_are_refused(tmp_path):
    with pytest.raises(StrategyError, match="is a folder"):
        require_output(tmp_path, overwrite=True)
    with pytest.raises(StrategyError, match="there is no folder"):
        require_output(tmp_path / "missing" / "out", overwrite=True)


def test_a_source_is_never_replaced_by_whichever_name(tmp_path):
    source, other = tmp_path / "source", tmp_path / "other"
    source.touch()
    other.touch()
    (tmp_path / "symbolic").symlink_to(source)
    os.link(source, tmp_path / "hard")
    for name in ("source", "symbolic", "hard", "../" + tmp_path.name + "/source"):
        with pytest.raises(StrategyError, match="is the file to read"):
            require_output(tmp_path / name, overwrite=True, sources=[other, source])
    require_output(tmp_path / "unlike", overwrite=True, sources=[other, source])
