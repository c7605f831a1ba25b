"""What the experimenter sees and orders, through real WebSockets."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest
from study_cases import ARROWS, CHOICE, ask, cube_mesh, moment_at, scene_around, served_study, square_hand, visit

from palpate.render.errors import RenderError
from palpate.render.study.pages.experimenter_page import ExperimenterPage, plain
from palpate.render.study.run.desk import StudyDesk

PATH = "/experimenter"


def test_status_and_the_participants_screen_are_shown():
    with served_study() as (desk, server), visit(server, PATH) as page:
        desk.set_status(participant="P03", trial=2, minutes_left=12.5)
        desk.show("question", "Which?", title="Part 1", keys=ARROWS, question=CHOICE, progress=0.5)
        answer = ask(page, ask="progress")
        assert answer["status"]["participant"] == "P03"
        assert (answer["status"]["has_page"], answer["status"]["is_stopped"]) == (False, False)
        assert answer["screen"] == {
            "kind": "question", "title": "Part 1", "text": "Which?", "hint": "", "question": "Which one felt denser?",
            "keys": ["ArrowRight: Second", "ArrowLeft: First"], "progress": 0.5,
        }  # fmt: skip


def test_looking_does_not_count_as_the_participants_page():
    with served_study() as (desk, server), visit(server, PATH) as page:
        desk.open_page()
        seen = desk._seen
        ask(page, ask="progress")
        assert desk._seen == seen


def test_stop_go_on_and_end_reach_the_desk():
    with served_study() as (desk, server), visit(server, PATH) as page:
        answer = ask(page, ask="stop")
        assert desk.is_stopped
        assert answer["status"]["stop_reason"] == "the experimenter has stopped it"
        assert ask(page, ask="go_on")["status"]["is_stopped"] is False
        assert not desk.is_stopped
        assert not desk.is_ended
        assert ask(page, ask="end")["status"]["is_ended"] is True
        assert desk.is_ended


def test_stop_waits_for_no_mesh_of_the_participants_page():
    loading, released = threading.Event(), threading.Event()

    def mesh(shown):
        loading.set()
        released.wait(10)
        return cube_mesh()

    from study_cases import show_object

    with served_study(mesh=mesh) as (desk, server), visit(server, PATH) as page, visit(server) as other:
        desk.show("stimulus", "1", **show_object())
        other.send('{"ask": "screen", "after": 0}')
        assert loading.wait(5)
        begun = time.monotonic()
        ask(page, ask="stop")
        assert time.monotonic() - begun < 1
        released.set()
        assert desk.is_stopped


def test_the_live_state_and_its_latency_are_shown():
    scene = scene_around(square_hand())
    with served_study(moment=lambda: moment_at(scene)) as (_, server), visit(server, PATH) as page:
        status = ask(page, ask="progress")["status"]
        assert (status["live"], status["latency"], status["dropped"]) == ("tracking", [0.004, 0.007], 3)


def test_a_session_that_has_ended_leaves_the_status():
    def fail():
        raise RenderError("the session has ended")

    with served_study(moment=fail) as (_, server), visit(server, PATH) as page:
        assert "live" not in ask(page, ask="progress")["status"]


def test_other_requests_are_refused_without_a_word_in_the_terminal(capfd):
    with served_study() as (_, server), visit(server, PATH) as page:
        for request in ({}, {"ask": "press"}, {"ask": 3}, {"ask": "screen", "after": 0}):
            assert "ask must be one of progress, stop, go_on, end" in ask(page, **request)["text"]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (float("nan"), None),
        (np.float32(0.5), 0.5),
        (np.arange(3), [0, 1, 2]),
        (Path("a/b"), "a/b"),
        ({"a": (1, None)}, {"a": [1, None]}),
        ("a\x1bb", "a\\x1bb"),
        (list(range(300)), list(range(200, 300))),
        (object, "<class 'object'>"),
        ([[[[[[1]]]]]], [[[[["[1]"]]]]]),
    ],
)
def test_any_status_becomes_what_json_takes(value, shown):
    assert plain(value) == shown


def test_its_line_in_a_log_says_whether_there_is_a_live_state():
    assert repr(ExperimenterPage(StudyDesk())) == "ExperimenterPage(no live state)"
