"""Pauses between trials against the real guard, which is fed the same emission as slices of frames."""

from typing import NamedTuple

import numpy as np
import pytest

from palpate.device import Limits, array_model
from palpate.device.errors import SafetyLimitError
from palpate.device.playing.limits import Dose, Guard
from palpate.render.errors import StudyError
from palpate.render.study.plan.duty_account import DutyAccount, EmissionInterval

MODEL = array_model("emulator")
PERIOD_NS = 1_000_000  # of a frame
SLICE = 50  # frames


def interval(seconds, duty=1.0, gap=0.0, stimulus="tube"):
    return EmissionInterval(stimulus=stimulus, seconds=seconds, duty=duty, gap=gap)


class Played(NamedTuple):
    """How an interval's drive is distributed over its frames."""

    interval: EmissionInterval
    place: float
    """Of its full drive: 0 at its beginning, 1 at its end."""

    def doses(self):
        """Doses of its slices: full drive for a part of it, and otherwise a drive so low that it counts as none."""
        count = round(self.interval.seconds * 1e9 / PERIOD_NS)
        full = int(self.interval.duty * count)
        first = round(self.place * (count - full))
        level = np.zeros(count)
        level[first : first + full] = 1.0
        for start in range(0, count, SLICE):
            own = level[start : start + SLICE]
            yield start, Dose(len(own), 0, len(own) - 1, float(own.sum()), float(own[-1]))


def play(guard, start, played):
    """Feed a trial to the guard from a time [s] on; returns when it has ended [s]."""
    for own in played:
        start += own.interval.gap
        start_ns = round(start * 1e9)
        for first, dose in own.doses():
            guard.admit(dose, start_ns + first * PERIOD_NS, PERIOD_NS)
        start += own.interval.seconds
        guard.silence(round(start * 1e9))
    return start


def note(account, start, intervals):
    for own in intervals:
        start += own.gap
        account.note(start, own.seconds, own.duty)
        start += own.seconds


def random_limits(rng):
    return Limits(
        on_time_max=None if rng.random() < 0.2 else float(rng.uniform(3, 12)),
        pause_min=float(rng.uniform(0.3, 2)),
        duty_max=None if rng.random() < 0.1 else float(rng.uniform(0.2, 0.9)),
        duty_window=float(rng.uniform(10, 30)),
    )


def random_trial(rng):
    return [
        Played(
            interval(
                round(float(rng.uniform(0.2, 4)), 3),
                float(rng.choice([1.0, rng.uniform(0.05, 1)])),
                float(rng.choice([0.0, rng.uniform(0, 3)])),
            ),
            float(rng.choice([0.0, 1.0, rng.random()])),
        )
        for _ in range(rng.integers(1, 4))
    ]


def run_random(seed, trial_count):
    """Trials one after the other with the least pauses; how many of them needed one, and how many were refused."""
    rng = np.random.default_rng(seed)
    limits = random_limits(rng)
    guard, account = Guard(limits, MODEL), DutyAccount(limits)
    now, paused, refused = float(rng.uniform(0, 5)), 0, 0
    for _ in range(trial_count):
        played = random_trial(rng)
        intervals = [own.interval for own in played]
        now += float(rng.choice([0.0, rng.uniform(0, 2)]))
        try:
            pause = account.pause_before(now, intervals)
        except StudyError:
            refused += 1
            continue
        paused += pause > 0
        note(account, now + pause, intervals)
        now = play(guard, now + pause, played)
    return paused, refused


def test_the_guard_never_stops_trials_that_keep_the_pauses():
    paused, refused = np.sum([run_random(seed, 12) for seed in range(30)], axis=0)
    assert paused > 75
    assert refused < 180


def shortened(seed, by):
    """Whether the guard stops the first trial that needs a long pause for its duty, if that is shortened [s]."""
    rng = np.random.default_rng(seed)
    limits = Limits(on_time_max=None, duty_max=0.4, duty_window=float(rng.integers(10, 30)))
    guard, account = Guard(limits, MODEL), DutyAccount(limits)
    now = float(rng.uniform(0, 5))
    while True:
        played = [Played(interval(round(float(rng.uniform(0.5, 3)), 3)), 0.0)]
        intervals = [own.interval for own in played]
        pause = account.pause_before(now, intervals)
        if pause > by:
            try:
                play(guard, now + pause - by, played)
            except SafetyLimitError as error:
                return "duty_max" in str(error)
            return False
        note(account, now + pause, intervals)
        now = play(guard, now + pause, played)


@pytest.mark.parametrize("seed", range(5))
def test_the_guard_stops_trials_whose_pause_is_shorter_by_more_than_its_buckets(seed):
    # The account counts emission for the window and 1.1 s more; the guard from the beginning of its second on.
    assert shortened(seed, by=2.2)
    assert not shortened(seed, by=0.0)


def test_a_pause_ends_an_emission_that_would_last_too_long():
    limits = Limits(on_time_max=10.0, pause_min=1.0)
    for shorter in (0.0, 0.2):
        guard, account = Guard(limits, MODEL), DutyAccount(limits)
        note(account, 0.0, [interval(7.0)])
        now = play(guard, 0.0, [Played(interval(7.0), 0.0)])
        pause = account.pause_before(now, [interval(4.0)])
        assert pause == pytest.approx(1.1)  # of 11 s together, 10 s are the bound
        again = [Played(interval(4.0), 0.0)]
        if shorter == 0.0:
            assert play(guard, now + pause, again) == pytest.approx(12.1)
        else:
            with pytest.raises(SafetyLimitError, match="on_time_max"):
                play(guard, now + pause - shorter, again)


def test_pauses_for_duty_are_those_worked_by_hand():
    # 5 s of any 10 s; 4 s were driven from 0 s on, so 3 s more at 4 s must wait until 2 s of them have left a window
    # of 11.1 s that ends with the trial: 13.1 s is the end of the trial, and 10.1 s its beginning.
    account = DutyAccount(Limits(duty_max=0.5, duty_window=10.0))
    account.note(0.0, 4.0, 1.0)
    assert account.pause_before(4.0, [interval(3.0)]) == pytest.approx(6.1)
    assert account.pause_before(4.0, [interval(1.0)]) == 0.0
    assert account.mean_duty(4.0) == pytest.approx(0.4)
    assert account.mean_duty(12.0) == pytest.approx(0.2)
    assert account.mean_duty(20.0) == 0.0


def test_a_trial_that_exceeds_the_time_by_itself_is_refused_with_value_bound_and_field():
    account = DutyAccount(Limits(on_time_max=10.0, duty_max=None))
    trial = [interval(6.0), interval(5.0, gap=1.0, stimulus="dog")]
    with pytest.raises(StudyError) as raised:
        account.pause_before(0.0, trial)
    assert str(raised.value) == (
        "on_time_max: dog, tube in one trial emit for 12.1 s without a pause of 1 s, but the bound is 10 s: a gap of "
        "1.1 s is a pause"
    )
    assert account.pause_before(0.0, [interval(6.0), interval(5.0, gap=1.1)]) == 0.0


def test_a_trial_that_exceeds_the_duty_by_itself_is_refused_with_value_bound_and_field():
    account = DutyAccount(Limits(duty_max=0.2, duty_window=20.0))
    with pytest.raises(StudyError) as raised:
        account.pause_before(0.0, [interval(3.0, stimulus="dog"), interval(2.0, gap=5.0)])
    assert str(raised.value) == (
        "duty_max: dog, tube in one trial have a mean duty of 0.25 over 20 s (duty_window), but the bound is 0.2"
    )
    assert account.pause_before(0.0, [interval(4.0)]) == 0.0
