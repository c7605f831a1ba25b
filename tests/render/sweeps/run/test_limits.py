"""How much memory a worker may take by default, and how long it may wait."""

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


def test_the_time_of_a_suspended_machine_is_no_time_that_a_worker_waited():
    now = [100.0]
    awake = limits.AwakeClock(lambda: now[0])
    readings = []
    for step in (0.5, 0.5, 36_000.0, 0.5, -3.0, 0.5):  # ten hours of sleep; a clock that was set back
        now[0] += step
        readings.append(awake())
    assert readings == [0.5, 1.0, 6.0, 6.5, 6.5, 7.0]
