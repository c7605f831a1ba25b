"""The log of a sweep: what is written is read back, what is no event is left out, and durations for people."""

from palpate.render.sweeps.run.log import SweepLog, clock_time, read_log


def test_events_come_back_and_what_is_none_is_left_out(tmp_path):
    path = tmp_path / "log.jsonl"
    with SweepLog(path) as log:
        log.write("start", plan="ü")
    path.write_bytes(path.read_bytes() + b'[1]\n3\n{"event": \n{"time": "t"}\n\xff\n' + b"[" * 10_000 + b"\n")
    with SweepLog(path) as other:
        other.write("end", recipes=3)
    first, last = read_log(path)
    assert (first["event"], first["plan"], first["run"]) == ("start", "ü", log.run)
    assert (last["event"], last["recipes"], last["run"]) == ("end", 3, other.run)
    assert read_log(tmp_path / "none.jsonl") == []


def test_a_log_that_is_a_link_takes_nothing(tmp_path):
    (tmp_path / "thesis.tex").write_text("mine")
    (tmp_path / "log.jsonl").symlink_to(tmp_path / "thesis.tex")
    with SweepLog(tmp_path / "log.jsonl") as log:
        log.write("start")
    assert (tmp_path / "thesis.tex").read_text() == "mine"
    assert read_log(tmp_path / "log.jsonl") == []


def test_durations_are_shown_in_two_units():
    shown = {0.04: "0.0 s", 9.44: "9.4 s", 9.5: "10 s", 59.6: "1 min 0 s", 75: "1 min 15 s", 3600: "1 h 0 min"}
    shown |= {2 * 3600 + 5 * 60 + 59: "2 h 5 min", 86_400 + 7200: "1 d 2 h"}
    assert {seconds: clock_time(seconds) for seconds in shown} == shown
