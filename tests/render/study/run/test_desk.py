"""What the desk takes as an answer, and when it lets something play."""

import threading

import pytest

from palpate.render.errors import StudyError
from palpate.render.study.plan.study_plan import Question
from palpate.render.study.run.desk import LOST_SECONDS, KeyChoice, StudyClock, StudyDesk

KEYS = (KeyChoice(key="ArrowLeft", label="Second", value=1), KeyChoice(key="ArrowRight", label="First", value=0))
AGE = Question(name="age", text="Your age?", kind="number", low=18, high=99)
NOTE = Question(name="note", text="Anything?", kind="text", is_optional=True)


@pytest.fixture
def desk():
    desk = StudyDesk()
    desk.open_page()
    return desk


def test_a_key_counts_once_and_only_for_the_screen_that_is_shown(desk):
    first = desk.show("question", "Which?", keys=KEYS)
    assert not desk.press(first.number, "a", 0.1)
    assert desk.press(first.number, "ArrowLeft", 0.3)
    assert not desk.press(first.number, "ArrowLeft", 0.4)  # pressed twice
    assert not desk.press(first.number, "ArrowRight", 0.4)
    response = desk.await_response(1.0)
    assert (response.value, response.key, response.seconds) == (1, "ArrowLeft", 0.3)
    second = desk.show("question", "And now?", keys=KEYS)
    assert not desk.press(first.number, "ArrowRight", 0.5)  # it was meant for the screen before
    assert desk.await_response(0.0) is None
    assert desk.press(second.number, "ArrowRight", 0.2)
    assert desk.await_response(1.0).value == 0
    assert desk.extra_presses == 4


@pytest.mark.parametrize("seconds", [0.0, 0.01])
def test_two_keys_at_the_same_time_give_one_answer(desk, seconds):
    screen = desk.show("question", "Which?", keys=KEYS)
    counted = []
    threads = [
        threading.Thread(target=lambda own=own: counted.append(desk.press(screen.number, own.key, seconds)))
        for own in KEYS * 4
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert counted.count(True) == 1


@pytest.mark.parametrize(
    ("question", "value", "text"),
    [
        (AGE, 17, "age must be from 18 to 99, not 17"),
        (AGE, None, "age must be answered"),
        (AGE, "18", "age must be a number, not '18'"),
        (AGE, True, "age must be a number, not True"),
        (AGE, float("nan"), "age must be a number, not nan"),
        (NOTE, 5, "note must be a text"),
        (NOTE, "x" * 10_001, "note must be a text of at most 10000 characters"),
    ],
)
def test_what_a_question_does_not_take_is_refused_and_may_be_typed_again(desk, question, value, text):
    screen = desk.show("question", question.text, question=question)
    with pytest.raises(StudyError, match=text):
        desk.give(screen.number, value, 1.0)
    good = 20 if question is AGE else None
    assert desk.give(screen.number, good, 2.0)
    assert desk.await_response(1.0).value == good


def test_a_stopped_study_takes_no_answer_until_it_goes_on(desk):
    screen = desk.show("question", "Which?", keys=KEYS)
    desk.stop("a question of the participant")
    assert desk.is_held
    assert desk.is_stopped
    assert not desk.press(screen.number, "ArrowLeft", 0.3)
    assert desk.status()["stop_reason"] == "a question of the participant"
    desk.go_on()
    assert not desk.is_held
    assert desk.press(screen.number, "ArrowLeft", 0.5)
    desk.end()
    assert desk.is_held
    assert desk.is_ended


class FixedClock(StudyClock):
    """It stands still until the test sets it."""

    seconds = 0.0

    def now(self) -> float:
        return self.seconds


def test_nothing_may_play_without_a_page_and_a_silent_page_counts_as_closed():
    clock = FixedClock()
    desk = StudyDesk(clock)
    assert desk.is_held
    page = desk.open_page()
    assert not desk.is_held
    with pytest.raises(StudyError, match="open already"):
        desk.open_page()
    clock.seconds = LOST_SECONDS
    assert desk.is_held
    other = desk.open_page()  # the browser was started again
    desk.close_page(page)  # the connection of the first page ends late, and must not close the second one
    assert not desk.is_held
    desk.close_page(other)
    assert desk.is_held
