"""`palpate study` as a person runs it: the whole program on the emulated array, answered over the page's own socket."""

import os
import re
import signal
import sqlite3
import subprocess
import sys
import threading
import time

import pytest
from answered_study import PageClient, take_part

from palpate.render import render, static_pose
from palpate.render.study import command

PLAN = """
title = "Which one is filled?"
participants = 2
seed = 3

[[stimulus]]
for = { strategy = ["oc", "cc"] }
name = "cube-{strategy}"
object = "cube"
strategy = "{strategy}"
duration = 0.5

[[stimulus]]
name = "still"
file = "still.h5"
duration = 0.3

[[block]]
name = "live"
design = "2ifc"
pairs = [["cube-oc", "cube-cc"]]
question = "Which one felt more filled?"
random_keys = true
gap = 0.2
rest = 0.0

[[block]]
name = "stored"
design = "rating"
stimuli = ["still"]
repetitions = 2
rest = 0.0
[[block.question]]
name = "strength"
text = "How strong was it?"
kind = "scale"
"""


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """A contour file that plays for 0.3 s."""
    folder = tmp_path_factory.mktemp("prepared")
    return render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(folder / "still.h5")


@pytest.fixture
def plan(tmp_path, prepared):
    (tmp_path / "still.h5").write_bytes(prepared.read_bytes())
    path = tmp_path / "filled.toml"
    path.write_text(PLAN)
    return path


def run_palpate(*words):
    """Exit code, standard output and standard error of a command."""
    done = subprocess.run(
        [sys.executable, "-m", "palpate.render.cli", *map(str, words)], capture_output=True, text=True, timeout=60
    )
    return done.returncode, done.stdout, done.stderr


class RunningStudy:
    """A process of `palpate study`, and the addresses that it tells."""

    def __init__(self, plan, *options):
        words = ["study", str(plan), "--no-browser", "--no-realtime", *options]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "palpate.render.cli", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, cwd=plan.parent, start_new_session=True,
        )  # fmt: skip
        self.lines, self.addresses = [], {}
        for line in self.process.stdout:
            self.lines.append(line)
            if found := re.match(r"the (\w+)'s page: (\S+)", line):
                self.addresses[found[1]] = line
            if "experimenter" in line:
                break

    def processes(self):
        """Numbers of this process and of those that it has started: the writer, the one that draws, the hand's."""
        listed = subprocess.run(["ps", "-A", "-o", "pid=,ppid="], capture_output=True, text=True, check=True).stdout
        children = [tuple(map(int, line.split())) for line in listed.splitlines()]
        found = [self.process.pid]
        for parent in found:
            found += [child for child, of in children if of == parent]
        return found

    def end(self, seconds=20):
        """Exit code, and all that was printed."""
        text, _ = self.process.communicate(timeout=seconds)
        return self.process.returncode, "".join(self.lines) + text


def rows(plan, statement):
    connection = sqlite3.connect(plan.with_suffix(".data") / "answers.sqlite")
    try:
        return connection.execute(statement).fetchall()
    finally:
        connection.close()


def is_running(number):
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    return True


def until(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return condition()


def test_options_of_events_need_the_socket_of_events(plan):
    options = {"events": None, "events_host": "127.0.0.1", "lsl": True, "plan": plan}
    with pytest.raises(command.StrategyError, match="--lsl is of --events"):
        command.run_study(options, as_json=False)


@pytest.mark.exhaustive
def test_two_participants_answer_whole_studies_and_their_stimuli_are_on_disk(plan):
    for code in ("P01", "P02"):
        study = RunningStudy(plan)
        take_part(study.addresses["participant"])
        assert study.end()[0] == 0
        assert rows(plan, f"SELECT finished IS NOT NULL FROM participants WHERE code = '{code}'") == [(1,)]
    answers = rows(plan, "SELECT code, block, trial, name FROM answers ORDER BY sequence")
    assert len(answers) == 2 * 4
    assert answers[0][1] != answers[4][1]  # the order of blocks is balanced
    intervals = rows(plan, "SELECT stimulus, outcome, onset - onset_planned, latency, r, poses, file FROM intervals")
    assert len(intervals) == 2 * (4 + 2)
    assert {outcome for _, outcome, *_ in intervals} == {"played"}
    assert all(late >= latency > 0 for _, _, late, latency, *_ in intervals)
    assert {(stimulus, file) for stimulus, *_, file in intervals if file} == {("still", "still.h5")}
    assert all(poses > 20 for stimulus, *_, poses, file in intervals if stimulus != "still")
    kept = plan.with_suffix(".data") / "poses"
    assert len(list(kept.glob("*.h5"))) == 8
    assert list(kept.glob("*.live")) == []
    code, _, err = run_palpate("study", plan, "--no-browser")
    assert code == 1
    assert "all 2 codes of the plan have begun" in err
    code, _, err = run_palpate("study", plan, "--no-browser", "--participant", "P01", "--resume")
    assert code == 1
    assert "participant P01 finished at" in err


@pytest.mark.exhaustive
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_an_ended_process_leaves_the_array_off_and_the_participant_goes_on(plan, number):
    study = RunningStudy(plan)
    page = PageClient(study.addresses["participant"])
    while page.screen.get("kind") != "stimulus":
        if page.look():
            page.answer()
        time.sleep(0.02)
    time.sleep(0.2)
    started = study.processes()
    assert len(started) >= 4
    study.process.send_signal(number)
    code, text = study.end()
    assert until(lambda: not any(map(is_running, started)))  # the writer has switched the array off, and ended
    assert code == -9 if number == signal.SIGKILL else code == 1
    assert ("the array is off" in text) is (number != signal.SIGKILL)
    code, _, err = run_palpate("study", plan, "--no-browser", "--participant", "P01")
    assert code == 1
    assert "--resume" in err
    if number != signal.SIGKILL:
        assert rows(plan, "SELECT outcome FROM intervals")[0][0].startswith("stopped after 0.")
    study = RunningStudy(plan, "--resume")  # the one who has begun
    take_part(study.addresses["participant"])
    code, text = study.end()
    assert code == 0, text
    assert len(rows(plan, "SELECT DISTINCT block, trial, name FROM answers")) == 4
    attempts = rows(plan, "SELECT block, trial, count(DISTINCT attempt) FROM intervals GROUP BY block, trial")
    assert sum(count > 1 for *_, count in attempts) <= 1


@pytest.mark.exhaustive
def test_a_closed_page_and_a_stop_end_the_interval_and_the_study_goes_on(plan):
    study = RunningStudy(plan)
    experimenter = PageClient(study.addresses["experimenter"])

    def play_until(kind):
        page = PageClient(study.addresses["participant"])
        while page.screen.get("kind") != kind:
            if page.look():
                page.answer()
            time.sleep(0.02)
        time.sleep(0.2)
        return page

    page = play_until("stimulus")
    page.close()
    assert until(lambda: len(rows(plan, "SELECT * FROM intervals")) == 1)
    assert rows(plan, "SELECT outcome FROM intervals")[0][0].startswith("stopped after")
    page = play_until("stimulus")
    experimenter.ask(ask="stop")
    assert until(lambda: len(rows(plan, "SELECT * FROM intervals WHERE outcome != 'played'")) == 2)
    assert page.look()
    assert page.screen["kind"] == "wait"
    experimenter.ask(ask="go_on")
    page.close()
    threading.Thread(target=take_part, args=(study.addresses["participant"],), daemon=True).start()
    code, _ = study.end()
    experimenter.close()
    assert code == 0
    assert len(rows(plan, "SELECT * FROM answers")) == 4
    events = [name for (name,) in rows(plan, "SELECT name FROM events")]
    assert events.count("stopped") >= 3  # two closed pages and one stop


@pytest.mark.exhaustive
def test_what_changed_since_the_first_participant_is_refused_and_two_processes_share_no_code(plan):
    study = RunningStudy(plan)
    code, _, err = run_palpate("study", plan, "--no-browser", "--participant", "P01", "--resume")
    assert code == 1
    assert "participant P01 is being run by another process" in err
    take_part(study.addresses["participant"])
    assert study.end()[0] == 0
    render("cube", "palm", static_pose([0, 0, 0.21]), "cc").save(plan.parent / "still.h5", overwrite=True)
    code, _, err = run_palpate("study", plan, "--no-browser")
    assert code == 1
    assert "a file of stimulus 'still' has changed since" in err
    plan.write_text(PLAN.replace("gap = 0.2", "gap = 0.3"))
    code, _, err = run_palpate("study", plan, "--no-browser")
    assert code == 1
    assert "gap = 0.3" in err
    assert os.path.getsize(plan.with_suffix(".data") / "answers.sqlite") > 0
