"""The list of strategies, and the picture of them."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from palpate.render.reports.strategy_gallery import draw_gallery, stage_rows, strategy_rows
from palpate.render.stages.registry import known_stages
from palpate.render.strategies.intersection_strategy import PRESETS


def test_every_preset_and_every_stage_is_listed_with_a_line():
    assert [name for name, _ in strategy_rows()] == list(PRESETS)
    assert all(line for _, line in strategy_rows())
    rows = stage_rows()
    for role in ("raw", "prune", "transform"):
        assert [name for row, name, _, _ in rows if row == role] == list(known_stages(role))
    options = {name: options for _, name, _, options in rows}
    assert options["inset"] == "distance=0.5 focal widths"
    assert "angle=0 rad" in options["hatch"]
    assert "connect=boundary" in options["hatch"]


def test_a_preset_that_a_user_adds_is_listed_by_its_docstring(monkeypatch):
    def mine():
        """What I need.

        And why.
        """
        return PRESETS["cc"]()

    monkeypatch.setitem(PRESETS, "mine", mine)
    assert ("mine", "What I need") in strategy_rows()


@pytest.mark.exhaustive
def test_the_picture_is_drawn(tmp_path):
    picture = tmp_path / "gallery.png"
    draw_gallery(picture, names=["oc", "corner-pauses", "hatch", "depth-hatch"])
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size > 20_000


DOCS = Path(__file__).parents[3] / "docs/guide/strategies.md"


def test_the_docs_list_every_preset_and_transform_stage_with_every_option():
    text = DOCS.read_text()
    rows = dict(re.findall(r"^\| `([a-z-]+)` \| ([^|]*) \|$", text, re.MULTILINE))
    assert {name: rows.get(name) for name, _ in strategy_rows()} == dict(strategy_rows())
    table = dict(re.findall(r"^\| `([a-z]+)` \| (.*\|.*)\|$", text, re.MULTILINE))
    told = {name: set(re.findall(r"`([a-z_]+)`", line)) for name, line in table.items()}
    told["circle"] |= told["ellipse"]
    for name, entry in known_stages("transform").items():
        if entry.own:
            assert set(entry.options) <= told[name], name


@pytest.mark.exhaustive
def test_the_examples_of_the_docs_run(tmp_path):
    text = DOCS.read_text()
    rendered, far, stages = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    first, flush, second = re.findall(r"```json\n(.*?)```", text, re.DOTALL)
    (tmp_path / "my_stages.py").write_text(stages)
    (tmp_path / "mine.json").write_text(second)
    json.loads(first)
    script = rendered + (
        "from palpate.render.strategies.intersection_strategy import load_strategy\n"
        f"assert IntersectionStrategy.from_json({first!r}).needs_closed\n"
        "assert batch.polyline_count > 0 and set(batch.kind.tolist()) == {2}\n"
        "striped = render(tube, Palm(), motion, load_strategy('mine.json', allow_code=True))\n"
        f"assert IntersectionStrategy.from_json({flush!r}).flush == 1e-6\n"
        f"{far}assert points.shape == batch.points.shape and abs(points.mean(axis=0)[2] - 0.2) < 0.1\n"
        "assert 0 <= striped.intensity.min() < 0.2 < 0.8 < striped.intensity.max() <= 1\n"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
