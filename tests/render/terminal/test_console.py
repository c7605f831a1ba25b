"""The console prints results as one JSON object for machines and as a table for people."""

import json

from palpate.render.terminal import console

STRATEGY = {"raw": "section", "prune": [{"stage": "close-together", "distance": 0.004}, "small"]}


def test_json_has_stages_with_options_as_objects(capsys):
    console.show_values({"strategy": STRATEGY}, as_json=True, title="")
    assert json.loads(capsys.readouterr().out) == {"strategy": STRATEGY}


def test_a_table_has_stages_with_options_as_words(capsys):
    console.show_values({"strategy": STRATEGY}, as_json=False, title="file.h5")
    assert "close-together (distance 0.004) small" in capsys.readouterr().out
