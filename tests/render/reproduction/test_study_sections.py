"""Sections of the report: what each holds, from lengths and meshes that are known."""

import re

import numpy as np
import pytest

from palpate.render.reproduction.explorations import BlockRatios, FeltLengths, StudySettings
from palpate.render.reproduction.objects_section import objects_section
from palpate.render.reproduction.paper_numbers import RATIOS
from palpate.render.reproduction.study_sections import frequency_section, people_section, ratio_section


def ratios(explorers):
    """r at the paper's means exactly, for both readings, with a little spread."""
    spread = np.linspace(-0.05, 0.05, 2 * explorers).reshape(explorers, 2)
    return {name: BlockRatios(mean + spread, mean - 0.1 + spread) for name, mean in RATIOS.items()}


def test_the_objects_fit_a_cube_of_130_mm_and_the_sphere_nearly_fills_its_circle():
    section, values = objects_section()
    assert list(values["objects"]) == ["tube", "dog", "cube", "sphere", "rock"]
    assert {round(max(found["size"]), 4) for found in values["objects"].values()} == {0.13}
    assert values["objects"]["cube"]["volume"] == pytest.approx(0.13**3, rel=1e-5)
    assert values["objects"]["sphere"]["volume"] == pytest.approx(np.pi / 6 * 0.13**3, rel=0.03)
    assert bytes(section.pictures[0].content[:4]) == b"\x89PNG"


def test_draw_frequencies_are_of_poses_with_contours():
    lengths = np.array([[[0.0, 0.1, 0.1]]], np.float32)
    section, values = frequency_section({"cube": FeltLengths("cube", 2 * lengths, lengths)})
    found = values["draw_frequency"]["cube"]
    assert found["oc"]["draw_frequency_of_mean_length"] == pytest.approx(70.0)
    assert found["cc"]["draw_frequency"] == pytest.approx(10_000 / 286)  # 0.2 m at 7 m/s: 285.7 samples
    assert section.tables[0].rows[0].why.startswith("Agrees")
    nothing = frequency_section({"cube": FeltLengths("cube", 0 * lengths, 0 * lengths)})
    assert nothing[0].tables[0].rows[0].why.startswith("No contour was met")
    assert nothing[1]["draw_frequency"]["cube"]["oc"]["draw_frequency"] is None


def test_ratios_stand_beside_the_papers_and_say_how_far_off_they_are():
    section, values = ratio_section(ratios(18), StudySettings())
    assert values["r"]["cube"]["mean"] == pytest.approx(2.54)
    assert values["r"]["cube"]["paper"] == 2.54
    assert values["r_open"]["dog"]["mean"] == pytest.approx(1.26)
    assert set(values["r"]) == {"cube", "tube", "dog"}
    assert max(values["r_tests"]["by_block"].values()) < 0.001
    assert section.tables[0].rows[0].ours == "r = 2.54 ± 0.03; r_open = 2.44 ± 0.03"
    assert section.tables[0].rows[0].why.startswith("r is within 10 % of the paper (+0 %; r_open -4 %)")
    assert "36 dots an object" in section.text


@pytest.mark.filterwarnings("error")
def test_ratios_of_one_block_or_none_are_shown_without_tests():
    one = {name: BlockRatios(np.full((1, 1), mean), np.full((1, 1), mean)) for name, mean in RATIOS.items()}
    one["dog"] = BlockRatios(*(np.full((1, 1), np.nan) for _ in range(2)))
    section, values = ratio_section(one, StudySettings(1, 1))
    assert values["r"]["tube"]["sd"] is None
    assert values["r_open"]["dog"]["mean"] is None
    assert section.tables[0].rows[2].ours == "r = none; r_open = none"
    assert section.tables[0].rows[-1].ours == "cube: no test; tube: no test; dog: no test"


def test_what_needs_people_is_listed_with_the_papers_numbers_and_the_commands():
    section = people_section()
    (table,) = section.tables
    found = {row[0].split(" (")[0]: row[1] for row in table.rows}
    assert found["p_CC above 0.5"] == found["p_CC is normally distributed"] == "p < 0.001"
    assert found["p_CC by object"] == "cube above tube, p = 0.03"
    assert found["p_CC by opacity"] == "opaque above transparent, p = 0.006"
    assert found["confidence by object"] == "cube above dog, p = 0.005; above tube, p = 0.012"
    assert found["difficulty by object"].endswith("p = 0.004 both")
    assert found["confidence and difficulty by opacity"] == "no significant effect, p = 0.05 both (as printed)"
    assert sum(map(int, re.findall(r"(?:^|; )(\d+)", found["p_CC of each participant"]))) == 18
    assert {row[2] for row in table.rows} == {"needs people"}
    commands = re.findall(r"`(.+?)`", section.text)
    assert commands == [
        "palpate study example paper", "palpate study paper.toml", "palpate study analyse paper.toml",
        "palpate study example pilot",
    ]  # fmt: skip
