"""How much memory a worker may take by default."""

from palpate.render.sweeps.run import limits


def test_workers_share_the_memory_but_each_may_load_a_large_mesh(monkeypatch, tmp_path):
    monkeypatch.setattr(limits, "machine_memory", lambda: 100 << 30)
    assert [limits.default_memory(count) >> 30 for count in (1, 2, 8, 64)] == [80, 40, 10, 4]
    monkeypatch.setattr(limits, "machine_memory", lambda: 2 << 30)
    assert limits.default_memory(8) == int(0.8 * (2 << 30))
    monkeypatch.undo()
    monkeypatch.setattr(limits, "CGROUP_MEMORY", tmp_path / "memory.max")
    whole = limits.machine_memory()
    for text, memory in (("max\n", whole), (f"{1 << 20}\n", 1 << 20), (f"{1 << 60}\n", whole)):
        (tmp_path / "memory.max").write_text(text)
        assert limits.machine_memory() == memory
