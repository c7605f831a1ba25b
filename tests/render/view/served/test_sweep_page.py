"""The table of a sweep as a page asks for it, and rows that open as renderings."""

import pytest
from typer.testing import CliRunner

from palpate.render import load_rig
from palpate.render.cli.app import app
from palpate.render.errors import StrategyError
from palpate.render.view.served.page_server import PageRequest
from palpate.render.view.served.sweep_page import SweepPage
from palpate.render.view.sweep_rows import SweepRows

pytestmark = pytest.mark.exhaustive  # a sweep runs in processes of its own


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    plan = folder / "plan.toml"
    plan.write_text('[object]\nsource = ["cube", "tube", "dog"]\n[motion]\nduration = 0.5\n')
    done = CliRunner().invoke(app, ["sweep", str(plan), "--device", "cpu", "--workers", "1", "-q"])
    assert done.exit_code == 0, done.output
    return folder / "plan.sweep"


@pytest.fixture
def page(store, tmp_path):
    return SweepPage(SweepRows(store), load_rig("emulator"), tmp_path)


def ask(page, **request):
    sent = []
    page.answer(PageRequest(request), lambda described, packer: sent.append(described))
    return sent[-1]


def test_rows_are_sorted_searched_and_counted(page):
    table = ask(page, ask="open")
    assert (table["kind"], table["count"], table["found"], table["page_count"]) == ("table", 3, 3, 1)
    axis = table["columns"][0]["name"]
    assert [row["cells"][0] for row in ask(page, ask="table", by=axis)["rows"]] == ["cube", "dog", "tube"]
    assert [row["number"] for row in ask(page, ask="table", by=axis, falling=True)["rows"]] == [1, 2, 0]
    found = ask(page, ask="table", containing="DOG")
    assert (found["found"], [row["number"] for row in found["rows"]]) == (1, [2])
    more = table["more"][0]
    assert more in [column["name"] for column in ask(page, ask="table", columns=[more, "no such"])["columns"]]
    with pytest.raises(StrategyError, match="by must be one of"):
        ask(page, ask="table", by="no such")


def test_rows_open_beside_each_other_and_the_table_comes_back(page):
    opened = ask(page, ask="rows", numbers=[0, 1])
    assert (opened["kind"], [file["object"] for file in opened["files"]]) == ("files", ["cube", "tube"])
    assert opened["titles"][1].startswith("row 1: ")
    assert "tube" in opened["titles"][1]
    assert ask(page, ask="moment", pose=[3])["poses"] == [3, 3]
    assert ask(page, ask="table")["kind"] == "table"
    with pytest.raises(StrategyError, match="ask must be one of open, table, rows"):
        ask(page, ask="moment", pose=[3])


@pytest.mark.parametrize("numbers", [[], [3]])
def test_numbers_of_no_row_are_refused(page, numbers):
    with pytest.raises(StrategyError, match=r"numbers must be (one whole number|2 whole numbers) of 0\.\.2"):
        ask(page, ask="rows", numbers=numbers)
