"""Names in any case, and the likely one; difflib is the standard library's measure of likeness."""

import pytest

from palpate.datasets.errors import ShapeError
from palpate.datasets.known_names import find_name, likely_file, likely_name, unknown_name
from palpate.datasets.shapes.built_in import shape

KNOWN = ("cube", "dog", "dog-detailed", "inset-hatch")


@pytest.mark.parametrize("written", ["inset-hatch", "INSET-HATCH", "Inset_Hatch", " inset hatch "])
def test_a_name_is_found_in_any_case_and_spelling(written):
    assert find_name(written, KNOWN) == "inset-hatch"


@pytest.mark.parametrize("other", ["", "cub", "cubes", 7, None, b"cube"])
def test_what_is_no_name_is_not_found(other):
    assert find_name(other, KNOWN) is None


def test_the_likely_name_is_suggested_and_none_without_likeness():
    assert likely_name("Cuhe", KNOWN) == " (did you mean 'cube'?)"
    assert likely_name("zzz", KNOWN) == likely_name(10**5000, KNOWN) == ""
    assert unknown_name("shape", "cuhe", ("cube", "dog")) == (
        "unknown shape 'cuhe' (did you mean 'cube'?); known: cube, dog"
    )


def test_a_file_of_the_folder_is_suggested(tmp_path):
    (tmp_path / "tube.h5").touch()
    (tmp_path / ".tube2.h5").touch()
    assert likely_file(tmp_path / "tub.h5") == " (did you mean 'tube.h5'?)"
    assert likely_file(tmp_path / "none" / "tub.h5") == likely_file("\0") == ""
    (tmp_path / "mug.ptlist").touch()
    assert likely_file(tmp_path / "mugg.stl") == ""  # a file of another kind is not meant by a name that is only alike
    assert likely_file(tmp_path / "mug.stl") == " (did you mean 'mug.ptlist'?)"


def test_a_symbolic_link_that_leads_nowhere_is_not_suggested_for_itself(tmp_path):
    (tmp_path / "tube.h5").symlink_to("tube.h5")
    (tmp_path / "tubes.h5").symlink_to("elsewhere.h5")
    assert likely_file(tmp_path / "tube.h5") == " (it is a symbolic link to 'tube.h5', which leads back to it)"
    assert likely_file(tmp_path / "tubes.h5") == " (it is a symbolic link to 'elsewhere.h5', which is not there)"


def test_an_unknown_shape_is_marked_as_a_name_that_stands_for_nothing():
    with pytest.raises(ShapeError, match=r"unknown shape 'tubes' \(did you mean 'tube'\?\)") as refusal:
        shape("tubes")
    assert refusal.value.names_nothing
    assert (shape("TUBE")[0] == shape("tube")[0]).all()
