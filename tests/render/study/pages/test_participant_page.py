"""What the participant's page is sent, and what it is not, through real WebSockets."""

import time

import numpy as np
from study_cases import (
    AGE,
    ARROWS,
    CHOICE,
    POSE,
    SCALE,
    SCALE_KEYS,
    WORDS,
    ask,
    cube_mesh,
    moment_at,
    raw_answer,
    scene_around,
    served_study,
    show_object,
    square_hand,
    visit,
    wait_until,
)
from virtual_clock import VirtualClock

from palpate.render import render, static_pose
from palpate.render.errors import RenderError
from palpate.render.sampling.metrics import FocalPoints
from palpate.render.study.pages.participant_page import ParticipantPage
from palpate.render.study.run.desk import StudyDesk


def test_a_screen_is_sent_once_and_then_its_number_only():
    with served_study() as (desk, server), visit(server) as page:
        desk.show("question", "Which?", title="Part 1", hint="Press", keys=ARROWS, question=CHOICE, progress=0.25)
        first = ask(page, ask="screen", after=0)
        assert first["number"] == 1
        assert first["screen"] == {
            "kind": "question",
            "text": "Which?",
            "title": "Part 1",
            "hint": "Press",
            "keys": [{"key": "ArrowRight", "label": "Second"}, {"key": "ArrowLeft", "label": "First"}],
            "question": {
                "kind": "choice", "text": "Which one felt denser?", "point_count": 7, "low_text": "", "high_text": "",
                "low": None, "high": None, "is_optional": False,
            },
            "shown": None,
            "has_noise": False,
            "progress": 0.25,
        }  # fmt: skip
        assert ask(page, ask="screen", after=1) == {"kind": "screen", "number": 1}
        desk.show("rest", "Rest", ends=time.monotonic() + 20)
        assert 19 < ask(page, ask="screen", after=1)["left"] <= 20
        assert 19 < ask(page, ask="screen", after=2)["left"] <= 20


def test_what_is_left_of_a_rest_is_counted_by_the_desks_clock():
    clock = VirtualClock()
    with served_study(StudyDesk(clock)) as (desk, server), visit(server) as page:
        desk.show("rest", "Rest", ends=clock.now() + 20)
        assert ask(page, ask="screen", after=0)["left"] == 20
        clock.sleep(15)
        assert ask(page, ask="screen", after=1)["left"] == 5


def test_neither_contours_nor_focal_points_nor_latency_nor_names_reach_the_participant():
    scene = scene_around(square_hand())
    focus = FocalPoints(np.full((3, 3), 0.12345, np.float32), np.full(3, 0.54321, np.float32))
    contours = render("cube", "palm", static_pose(POSE[:3]), "cc")
    moment = moment_at(scene, contours=contours, focus=focus)
    values = [*contours.points.ravel(), *focus.position.ravel(), *focus.intensity, 0.004, 0.007, 40_000, 3]
    found = {np.float32(v).tobytes() for v in values} - {
        np.float32(v).tobytes() for v in (0, 0.2, *cube_mesh()[0].flat)
    }
    with served_study(scene=lambda: scene, moment=lambda: moment) as (desk, server), visit(server) as page:
        desk.set_status(stimulus="tube_oc", latency=0.004)
        desk.show("stimulus", "1", **show_object(solid="objects/hidden.stl"))
        for request in ('{"ask":"screen","after":0}', '{"ask":"screen","after":1}', '{"ask":"object"}'):
            answer, sent = raw_answer(page, request)
            assert not any(value in sent for value in found)
            assert not any(word in sent for word in (b"hidden", b"secret", b"latency", b"contour", b"focus", b"_oc"))
        assert answer["kind"] == "object"


def test_the_hand_is_sent_while_a_stimulus_plays_and_it_may_be_seen():
    scene = scene_around(square_hand())
    moments = [moment_at(scene)]
    with served_study(scene=lambda: scene, moment=lambda: moments[0]) as (desk, server), visit(server) as page:
        for kind, shown in (("text", show_object()), ("stimulus", show_object(has_hand=False)), ("stimulus", {})):
            desk.show(kind, "1", **shown)
            assert "hand" not in ask(page, ask="screen", after=0)
        desk.show("stimulus", "1", **show_object())
        hand = ask(page, ask="screen", after=0)["hand"]
        assert (hand["pose"].tolist(), hand["patches"].tolist()) == (POSE.tolist(), [])
        mesh = ask(page, ask="object")["hand"]
        assert mesh["number"] == hand["number"] == 1
        assert mesh["vertices"].tolist() == square_hand()[0].tolist()
        gone = (None, moment_at(scene, pose=None, state="no hand"), moment_at(scene, state="faded"))
        for moments[0] in (*gone, moment_at(scene, pose=np.full(7, np.nan, np.float32))):
            assert ask(page, ask="screen", after=0)["hand"] is None


def test_of_a_hand_without_a_mesh_its_planes_are_sent():
    scene = scene_around((np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)))
    with served_study(moment=lambda: moment_at(scene)) as (desk, server), visit(server) as page:
        desk.show("stimulus", "1", **show_object())
        assert ask(page, ask="screen", after=0)["hand"]["patches"].shape == (4, 3)


def test_a_session_that_cannot_say_where_the_hand_is_leaves_the_screen():
    def fail():
        raise RenderError("the session has ended")

    with served_study(moment=fail) as (desk, server), visit(server) as page:
        desk.show("stimulus", "1", **show_object())
        assert ask(page, ask="screen", after=0)["hand"] is None


def test_a_press_counts_once_and_for_its_screen_only():
    with served_study() as (desk, server), visit(server) as page:
        number = desk.show("question", "Which?", keys=ARROWS, question=CHOICE).number
        press = {"ask": "press", "key": "ArrowLeft", "seconds": 0.5}
        assert ask(page, **press, screen=number - 1) == {"kind": "press", "counts": False}
        assert ask(page, **press | {"key": "x"}, screen=number)["counts"] is False
        assert ask(page, **press, screen=number)["counts"] is True
        assert ask(page, **press, screen=number)["counts"] is False
        response = desk.await_response(0)
        assert (response.value, response.key, response.seconds) == (0, "ArrowLeft", 0.5)
        assert desk.extra_presses == 3


def test_what_is_typed_counts_or_is_refused_with_a_sentence():
    with served_study() as (desk, server), visit(server) as page:
        number = desk.show("question", "Age?", question=AGE).number
        give = {"ask": "give", "screen": number, "seconds": 2}
        assert ask(page, **give, value=7)["text"] == "age must be from 18 to 99, not 7"
        assert "must be answered" in ask(page, **give, value=None)["text"]
        assert ask(page, **give, value=31)["counts"] is True
        assert ask(page, **give, value=32)["counts"] is False
        assert desk.await_response(0).value == 31
        number = desk.show("question", "Age?", question=AGE, refusal="Bitte von 18 bis 99.").number
        assert ask(page, **give | {"screen": number}, value=7)["text"] == "Bitte von 18 bis 99."
        number = desk.show("question", "Words?", question=WORDS).number
        assert ask(page, **give | {"screen": number}, value="rough \ud83d edge")["counts"] is True
        assert desk.await_response(0).value == "rough ? edge"  # half of a character is no text


def test_large_numbers_are_stored_as_what_a_database_takes():
    from dataclasses import replace

    with served_study() as (desk, server), visit(server) as page:
        number = desk.show("question", "?", question=replace(AGE, low=None, high=None)).number
        assert ask(page, ask="give", screen=number, value=10**30, seconds=1)["counts"]
        assert desk.await_response(0).value == 1e30
        assert isinstance(desk.await_response(0).value, float)


def test_one_page_is_open_at_a_time_and_the_second_takes_over_when_the_first_is_closed():
    with served_study() as (desk, server), visit(server) as second:
        with visit(server) as first:
            assert ask(first, ask="screen", after=0)["kind"] == "screen"
            for request in ({"ask": "screen", "after": 0}, {"ask": "press", "screen": 0, "key": "x", "seconds": 0}):
                assert "open already" in ask(second, **request)["text"]
            assert ask(first, ask="screen", after=0)["kind"] == "screen"
            assert desk.has_page
        assert wait_until(lambda: not desk.has_page)
        assert ask(second, ask="screen", after=0)["kind"] == "screen"
        assert desk.has_page


def test_a_page_that_is_refused_closes_nothing_when_it_goes():
    with served_study() as (desk, server), visit(server) as first:
        ask(first, ask="screen", after=0)
        with visit(server) as second:
            ask(second, ask="screen", after=0)
        assert not wait_until(lambda: not desk.has_page, 0.1)


def test_a_page_that_was_lost_gives_way_and_is_refused_when_it_comes_back(monkeypatch):
    monkeypatch.setattr("palpate.render.study.run.desk.LOST_SECONDS", 0.05)
    with served_study() as (desk, server), visit(server) as first, visit(server) as second:
        ask(first, ask="screen", after=0)
        time.sleep(0.06)
        assert not desk.has_page
        assert ask(second, ask="screen", after=0)["kind"] == "screen"
        assert "open already" in ask(first, ask="screen", after=0)["text"]


def test_a_page_that_was_lost_goes_on_when_no_other_one_came(monkeypatch):
    monkeypatch.setattr("palpate.render.study.run.desk.LOST_SECONDS", 0.05)
    with served_study() as (desk, server), visit(server) as page:
        ask(page, ask="screen", after=0)
        time.sleep(0.06)
        assert not desk.has_page
        ask(page, ask="screen", after=0)
        assert desk.has_page


def test_a_hidden_page_is_answered_as_late_as_it_asks():
    with served_study() as (_, server), visit(server) as page:
        begun = time.monotonic()
        ask(page, ask="screen", after=0, wait=0.1)
        assert 0.1 <= time.monotonic() - begun < 1


def test_the_state_of_the_sound_is_for_the_experimenter():
    with served_study() as (desk, server), visit(server) as page:
        for sound, words in (("off", "no key"), ("blocked", "blocked"), ("missing", "no sound card")):
            ask(page, ask="screen", after=0, sound=sound)
            assert words in desk.status()["sound"]


def test_noise_is_as_loud_as_the_plan_has_it():
    with served_study(noise_level=0.25) as (_, server), visit(server) as page:
        loop = ask(page, ask="noise", rate=8000)["samples"]
        assert loop.shape == (80_000,)
        assert np.abs(loop).max() == np.float32(0.25)


def test_control_characters_of_a_plan_do_not_reach_the_page_and_its_lines_do():
    with served_study() as (desk, server), visit(server) as page:
        desk.show("question", "a\x1b[31m\u202eb\nc", keys=SCALE_KEYS, question=SCALE)
        text = ask(page, ask="screen", after=0)["screen"]["text"]
        assert "\x1b" not in text
        assert "\u202e" not in text
        assert text.endswith("b\nc")


def test_its_line_in_a_log_has_the_sound():
    page = ParticipantPage(StudyDesk(), lambda: None, lambda: None, cube_mesh)
    assert repr(page) == "ParticipantPage(sound off)"
