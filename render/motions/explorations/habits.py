"""Persons who explore objects over an array: the size of the hand and the habits of each, by number."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ....datasets.errors import MotionError

NUMBER_MOST = 2**63 - 1
"""Largest number of a person and largest seed: HDF5 stores them as signed 64-bit integers."""
SIDES = ("above", "front", "left", "right")
"""Where a visit enters the workspace from: not from behind, where the user cannot reach, and not through the array."""

PERSON_KEY = 2**64 - 1  # second word of the key of a person's numbers; trials have their seed there, which is less
BREADTHS = ((0.0904, 0.0042), (0.0794, 0.0038))  # mean and standard deviation of men and women [m]
LENGTH_SHARE = 100.0 / 85.0  # length of a palm in breadths
PITCH_SD, ROLL_SD, YAW_SD = (math.radians(degrees) for degrees in (6.0, 4.5, 20.0))  # between persons [rad]
SPEED_LOW, SPEED_HIGH = 0.07, 0.30  # of persons' mean stroke [m/s]
PAUSE_LOW, PAUSE_HIGH = 0.2, 0.6  # share of strokes that end with a pause, of persons


@dataclass(frozen=True)
class ExplorerHabits:
    """The hand and the habits of one person; `explorer_habits` makes them of a number.

    >>> from palpate.render import explorer_habits
    >>> person = explorer_habits(7)
    >>> person
    ExplorerHabits(palm 78 x 92 mm, 0.10 m/s, from the front)
    """

    palm_width: float
    """A palm size that fits the person's hand, a suggestion for `Palm(width, length)`: its width [m] ..."""
    palm_length: float
    """... and length [m]. Explorations do not depend on it."""
    pitch: float
    """Mean pitch [rad], fingers up positive."""
    roll: float
    """Mean roll [rad], the side of +X (a right hand's little finger) up positive."""
    yaw: float
    """Mean direction of the fingers [rad]: 0 away from the user (+y), positive to the left."""
    speed: float
    """Mean speed of a stroke of average speed [m/s]."""
    pause_share: float
    """Share of the strokes that end with a pause."""
    side: str
    """Preferred side of approach, one of `SIDES`."""

    def __repr__(self) -> str:
        """One line."""
        size = f"palm {1e3 * self.palm_width:.0f} x {1e3 * self.palm_length:.0f} mm"
        side = "above" if self.side == "above" else f"the {self.side}"
        return f"ExplorerHabits({size}, {self.speed:.2f} m/s, from {side})"


def explorer_habits(explorer: int) -> ExplorerHabits:
    """Make the hand and the habits of a person from a number; the same number is always the same person.

    | habit | distribution | source |
    |---|---|---|
    | palm width | half men, half women: 90.4 (4.2) and 79.4 (3.8) mm | hand breadth, Gordon et al. 1989 |
    | palm length | 100 / 85 of the width | an adult's palm of 85 x 100 mm |
    | pitch, roll | mean 0, standard deviations 6 and 4.5 degrees | palm down; as between waypoints, see `over_array` |
    | yaw | mean 0, standard deviation 20 degrees | means of the clips: -21, -9, 8, 27 degrees |
    | speed | uniform in 0.07 to 0.30 m/s | means of the clips while they move: 0.07, 0.11, 0.11, 0.30 m/s |
    | pause share | uniform in 0.2 to 0.6 | the clips are slower than 0.03 m/s for 1 to 56 % of their time |
    | side | each alike | no source |

    The clips are four recordings of gestures by a Leap Motion controller (leapjs-playback), and no explorations: they
    bound how far and how fast hands turn and move. Numbers beyond two standard deviations are set to two.
    Raises MotionError for what is no integer of 0 to 2^63 - 1.

    >>> from palpate.render import explorer_habits
    >>> [explorer_habits(number).side for number in range(1, 6)]
    ['right', 'right', 'left', 'above', 'above']
    """
    require_whole("explorer", explorer)
    return _habits(int(explorer))


@lru_cache(maxsize=4096)  # a sweep asks for the same persons again and again
def _habits(explorer: int) -> ExplorerHabits:
    # The generator of the kernels. NumPy adds 1 to the counter first: these are the numbers of the counters 0 to 4.
    words = np.random.Philox(key=explorer + (PERSON_KEY << 64), counter=2**256 - 1).random_raw(20).reshape(5, 4)
    uniform = (words >> np.uint64(11)) * 2.0**-53
    # A sum of four is nearly normal, and needs no logarithm. Its standard deviation is 0.97, as 4 % are set to 2.
    bell = np.clip((uniform.sum(axis=1) - 2.0) * math.sqrt(3.0), -2.0, 2.0).tolist()
    first = uniform[0].tolist()
    mean, deviation = BREADTHS[int(2.0 * first[0])]
    width = mean + deviation * bell[1]
    return ExplorerHabits(
        palm_width=width,
        palm_length=LENGTH_SHARE * width,
        pitch=PITCH_SD * bell[2],
        roll=ROLL_SD * bell[3],
        yaw=YAW_SD * bell[4],
        speed=SPEED_LOW + (SPEED_HIGH - SPEED_LOW) * first[1],
        pause_share=PAUSE_LOW + (PAUSE_HIGH - PAUSE_LOW) * first[2],
        side=SIDES[int(len(SIDES) * first[3])],
    )


def require_whole(name: str, value: object) -> None:
    """Raise MotionError unless it is an integer of 0 to `NUMBER_MOST`."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= NUMBER_MOST:
        raise MotionError(f"{name} must be an integer of 0 to {NUMBER_MOST}, got {value!r}")
