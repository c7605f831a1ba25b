"""What parents fetch from a shared place: whole shards and the kept files that they name, and nothing else."""

import os

import pytest
from contour_cases import make_contours, write_file
from sweep_store_rows import write_rows

from palpate.datasets.sweeps.shard import ShardRow, read_shard, write_shard
from palpate.render.sweeps.run.sharing import Sharing


@pytest.fixture
def parents(tmp_path):
    """Two parents of one place, each with a store's folder of its own."""
    opened = []
    for name in ("one", "two"):
        (tmp_path / name / "shards").mkdir(parents=True)
        sharing = Sharing(tmp_path / name, f"file://{tmp_path}/shared")
        sharing.open()
        opened.append(sharing)
    yield opened
    for sharing in opened:
        sharing.close()


def shard_about(folder, path, name="a.h5"):
    write_shard(folder / "shards" / name, [ShardRow("keep-contours", "k", 0, {"path": path, "bytes": 3})])
    return f"shards/{name}"


def test_contours_come_with_the_file_that_names_their_code(parents, tmp_path):
    one, two = parents
    (tmp_path / "one/contours").mkdir()
    write_file(tmp_path / "one/contours/k.h5", make_contours(5))
    (tmp_path / "one/contours/k.json").write_text('{"maker": "m"}')
    one.publish(shard_about(tmp_path / "one", "contours/k.h5"))
    assert two.fetch() == ["shards/a.h5"]
    for name in ("contours/k.h5", "contours/k.json", "shards/a.h5"):
        assert (tmp_path / "two" / name).read_bytes() == (tmp_path / "one" / name).read_bytes()
    assert (two.fetch(), two.problems) == ([], [])


@pytest.mark.parametrize("path", ["same-results.json", "parents", "../../x", "/etc/passwd", "columns/x.h5"])
def test_a_shard_cannot_bring_any_other_file(parents, tmp_path, path):
    _, two = parents
    shard_about(tmp_path / "one", path)
    (tmp_path / "shared/shards").mkdir(parents=True, exist_ok=True)
    os.replace(tmp_path / "one/shards/a.h5", tmp_path / "shared/shards/a.h5")
    assert two.fetch() == []
    assert "shards/a.h5 is left out" in two.problems[0]
    assert not list((tmp_path / "two/shards").iterdir())


def test_what_is_damaged_or_foreign_is_left_out_once(parents, tmp_path):
    one, two = parents
    write_rows(tmp_path / "one/shards/good.h5", [("contours", "a", 0)])
    one.publish("shards/good.h5")
    shared = tmp_path / "shared/shards"
    (shared / ".DS_Store").write_bytes(b"x")
    (shared / "zz.h5").write_text("junk")
    write_shard(shared / "list.h5", [ShardRow("keep-contours", "k", 0, [1])])
    assert two.fetch() == ["shards/good.h5"]
    assert read_shard(tmp_path / "two/shards/good.h5").places == (("contours", "a", 0),)
    assert sorted(text.split(" ")[0].rpartition("/")[2] for text in two.problems) == ["list.h5", "zz.h5"]
    assert two.fetch() == []
    assert len(two.problems) == 2
