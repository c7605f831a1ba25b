"""Persons: the same number is the same person, and a population has the sizes and habits of the table."""

import numpy as np
import pytest

from palpate.datasets.errors import MotionError
from palpate.render import explorer_habits
from palpate.render.motions.explorations.habits import SIDES


def test_a_population_has_the_distributions_of_the_table():
    people = [explorer_habits(number) for number in range(600)]
    width, pitch, roll, yaw, speed, pause = (
        np.array([getattr(person, name) for person in people])
        for name in ("palm_width", "pitch", "roll", "yaw", "speed", "pause_share")
    )
    assert width.mean() == pytest.approx(0.0849, abs=5e-4)
    assert 0.0718 <= width.min() < width.max() <= 0.0988
    assert np.degrees([pitch.std(), roll.std(), yaw.std()]) == pytest.approx([5.8, 4.4, 19.4], rel=0.08)
    assert np.abs(np.degrees([pitch.mean(), roll.mean(), yaw.mean()])).max() < 1.5
    assert (speed.min(), speed.max()) == pytest.approx((0.07, 0.30), abs=2e-3)
    assert (pause.min(), pause.max()) == pytest.approx((0.2, 0.6), abs=2e-3)
    assert all(0.2 < np.mean([person.side == side for person in people]) < 0.3 for side in SIDES)


@pytest.mark.parametrize("number", [-1, 2**63, 1.0, True, "1"])
def test_what_is_no_number_of_a_person_is_refused(number):
    with pytest.raises(MotionError, match="explorer must be an integer of 0 to 9223372036854775807, got"):
        explorer_habits(number)
