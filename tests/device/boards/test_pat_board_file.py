"""Board files (`.pat`): lists wrapped over lines, as 8 of the 74 published ones have them, and files that are wrong.

How the published files are laid out is taken from RMResearch/OpenMPD, `OpenMPD_Client/board_*.pat`; boards 5, 37, 40,
41, 44, 54, 55 and 61 there have their phase offsets in 16 lines of 16 numbers, each ending with a comma.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from board_file_cases import board_lines, write
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.device.boards.pat16.board_file import PatFile, read_pat
from palpate.device.errors import CalibrationError, DeviceError
from palpate.device.registry import array_model

PINS, OFFSETS, FACTORS = 5, 6, 7  # line of each list of numbers in a file of seven lines
NAMES = {PINS: "the pins", OFFSETS: "the phase offsets", FACTORS: "the amplitude factors"}


def unwrapped() -> list[str]:
    return board_lines(np.random.default_rng(3))[0]


def wrapped(line: str, width: int, ending: str = ",\n") -> str:
    """A list of numbers in lines of `width`."""
    numbers = line.rstrip(",").split(",")
    rows = [",".join(numbers[start : start + width]) for start in range(0, len(numbers), width)]
    return ending.join(rows) + ending.rstrip("\n")


def content(file: PatFile) -> tuple:
    lists = (file.position, file.pin, file.phase_offset, file.gain)
    return (file.serial, file.levels, *(values.tolist() for values in lists))


def test_phase_offsets_in_16_lines_as_published_are_read(tmp_path: Path) -> None:
    plain = write(tmp_path / "plain.pat", unwrapped())
    lines = unwrapped()
    lines[OFFSETS - 1] = wrapped(lines[OFFSETS - 1], 16)
    assert "\n".join(lines).count("\n") == 6 + 15
    assert content(read_pat(write(tmp_path / "wrapped.pat", lines))) == content(read_pat(plain))
    model, same = array_model("pat16", calibration=tmp_path / "wrapped.pat"), array_model("pat16", calibration=plain)
    assert np.array_equal(model.delay_offset, same.delay_offset)
    assert len(set(model.delay_offset.tolist())) > 100


@pytest.mark.exhaustive
@settings(max_examples=40)
@given(
    widths=st.lists(st.integers(1, 300), min_size=3, max_size=3),
    comma=st.booleans(),
    blank=st.booleans(),
    ending=st.sampled_from(["\n", "\r\n"]),
)
def test_however_a_list_is_wrapped_it_says_the_same(
    tmp_path_factory: pytest.TempPathFactory, widths: list[int], comma: bool, blank: bool, ending: str
) -> None:
    folder = tmp_path_factory.mktemp("boards")
    lines = unwrapped()
    plain = content(read_pat(write(folder / "plain.pat", lines)))
    for line, width in zip((PINS, OFFSETS, FACTORS), widths, strict=True):
        lines[line - 1] = wrapped(lines[line - 1], width, ",\n" if comma else "\n")
    lines[3] = lines[3].replace("),(", "),\n(", widths[0]).replace(", ", ",\n", widths[1])  # within a position, too
    text = ("\n\n" if blank else "\n").join(lines).replace("\n", ending)
    assert content(read_pat(write(folder / "wrapped.pat", [text], ending))) == plain


@pytest.mark.parametrize(
    ("line", "width", "count", "message"),
    [
        (PINS, 300, 255, "the pins, which begin in line 5, hold 511 items (255 without line 6) where 256 belong"),
        (PINS, 16, 255, "the pins, which begin in line 5, hold 511 items (255 without line 21) where 256 belong"),
        (PINS, 16, 257, "the phase offsets, which begin in line 21, hold 257 items (1 without line 22) where"),
        (OFFSETS, 16, 255, "the phase offsets, which begin in line 6, hold 511 items (255 without line 22) where"),
        (OFFSETS, 16, 257, "the amplitude factors, which begin in line 22, hold 257 items (1 without line 23)"),
        (FACTORS, 300, 255, "ends where item 256 of 256 of the amplitude factors should be"),
        (FACTORS, 300, 257, "the amplitude factors, which begin in line 7, hold 257 items where 256 belong"),
        (FACTORS, 16, 255, "ends where item 256 of 256 of the amplitude factors should be"),
        (FACTORS, 16, 257, "the amplitude factors, which begin in line 7, should end the file, but line 23 follows"),
    ],
)
def test_a_number_too_few_or_too_many_is_refused(
    tmp_path: Path, line: int, width: int, count: int, message: str
) -> None:
    lines = unwrapped()
    lines[line - 1] = wrapped(",".join([*lines[line - 1].rstrip(",").split(","), "0"][:count]), width)
    with pytest.raises(CalibrationError, match=re.escape(f"{tmp_path / 'b.pat'}: {message}")):
        read_pat(write(tmp_path / "b.pat", lines))


@pytest.mark.parametrize("line", [PINS, OFFSETS, FACTORS])
def test_letters_are_refused_with_list_and_word(tmp_path: Path, line: int) -> None:
    for word in ("x", "1e999", "nan", "", "1 2"):
        lines = unwrapped()
        numbers = lines[line - 1].split(",")
        numbers[100] = word
        lines[line - 1] = wrapped(",".join(numbers), 16)
        message = f"{NAMES[line]}, which begin in line {line}, have {word!r} where a number belongs"
        with pytest.raises(CalibrationError, match=re.escape(message)):
            read_pat(write(tmp_path / "b.pat", lines))


@pytest.mark.parametrize(
    ("line", "old", "new", "message"),
    [
        (1, "FT4TKZL8", "", "line 1 is empty, but should hold the serial number"),
        (2, "256", "two", "the count of transducers is 'two', but should be a whole number from 1"),
        (2, "256", "255", "the positions, which begin in line 4, hold 256 items where 255 belong"),
        (2, "256", "257", "ends where item 257 of 257 of the positions should be"),
        (3, "128", "-1", "the steps of phase is '-1'"),
        (3, "128", "32", "describes a board of 256 transducers and 32 steps of phase, but a pat16 has 256 and 128"),
        (4, "(-0.078750, 0.078750", "(-78.750, 0.078750", "have a position of -78.75, which is not within 1 m"),
        (4, "(-0.078750, 0.078750, 0.000000)", "(-0.078750, 0.078750)", "have one with 2 numbers where 3 belong"),
        (4, "(-0.078750, 0.078750", "(x, 0.078750", "have 'x' where a number belongs"),
        (4, "(-0.078750, 0.078750", "(nan, 0.078750", "have 'nan' where a number belongs"),
        (4, "(-0.078750, 0.078750", "junk (-0.078750, 0.078750", "should be `(x, y, z)` only"),
        (4, "(-0.078750, 0.078750", "(-0.068250, 0.078750", "the positions are not 16 x 16 at 10.5 mm"),
        (4, "0.000000", "0.006000", "one is 6 mm beside its place, but half a pitch"),
    ],
)
def test_a_wrong_board_file_is_refused_with_what_is_wrong(
    tmp_path: Path, line: int, old: str, new: str, message: str
) -> None:
    lines = unwrapped()
    lines[line - 1] = lines[line - 1].replace(old, new, 1)
    with pytest.raises(CalibrationError, match=re.escape(message)) as caught:
        array_model("pat16", calibration=write(tmp_path / "board.pat", lines))
    assert str(caught.value).startswith(str(tmp_path / "board.pat"))
    assert isinstance(caught.value, DeviceError)


def test_values_out_of_range_are_refused_with_list_value_and_bound(tmp_path: Path) -> None:
    for line, values, message in (
        (PINS, [0, *range(255)], "the pins, which begin in line 5, have pin 0 more than once"),
        (PINS, [256, *range(255)], "have a pin of 256, which is not a whole number in 0..255"),
        (PINS, [0.5, *range(255)], "have a pin of 0.5, which is not a whole number in 0..255"),
        (OFFSETS, [361] + [0] * 255, "have a phase offset of 361, which is not within 360 degrees"),
        (FACTORS, [1.01] + [1] * 255, "have an amplitude factor of 1.01, which is not in 0..1"),
    ):
        lines = unwrapped()
        lines[line - 1] = wrapped(",".join(map(str, values)), 16)
        with pytest.raises(CalibrationError, match=re.escape(message)):
            read_pat(write(tmp_path / "board.pat", lines))


def test_what_is_no_board_file_is_refused(tmp_path: Path) -> None:
    cases = ((b"", "ends where the serial"), (b"\xff\xfe\x00" * 9, "is not text"), (b"1\n" * 600_000, "1 MiB"))
    for wrong, message in cases:
        (tmp_path / "x.pat").write_bytes(wrong)
        with pytest.raises(CalibrationError, match=message):
            read_pat(tmp_path / "x.pat")
    with pytest.raises(CalibrationError, match="cannot be read: No such file"):
        read_pat(tmp_path / "missing.pat")
    with pytest.raises(CalibrationError, match="array emulator has no board file"):
        array_model("emulator", calibration=tmp_path / "x.pat")
