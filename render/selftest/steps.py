"""The steps of a first hour with a real board, as data: what is played, what is asked, what each wrong answer means.

docs/guide/first-contact.md is the same for people; a test holds that both agree.
"""

from ...device.array import ArrayModel
from .frames import FeltStimulus
from .question import HEARD, SLOW_DIVIDER, TURN_RADIUS, Answer, Step, carries_tones, has_plug, is_behind_a_chip


def steps_for(model: ArrayModel) -> tuple[Step, ...]:
    """The steps that make sense for an array, in their order."""
    return tuple(step for step in STEPS if step.suits(model))


_GRID = (
    "`PatLink` in device/boards/pat16/link.py: the bytes sent since the board's last clear must be a multiple of "
    "512 at each frame."
)
_WIRING = (
    "pat16: lines 4 and 5 of its board file, or `_published` in device/boards/pat16/kind.py without one; "
    "sonicsurface: `_at_rate` in device/boards/sonicsurface/kind.py; "
    "autd3: `autd3_model` in device/boards/autd3/kind.py."
)
_OFFSETS = "pat16: `--calibration` with the board's own file, line 6 of which has the phase offsets."
_NOTHING = "`palpate devices` and the supply; pat16: the mode of its FT232H (docs/guide/first-contact.md, failure 3)."

_SILENT = Step(
    "silent",
    "Nothing is played. Listen, and hold a hand 20 cm above the array.",
    "Is the array silent?",
    (
        Answer("silent", "Nothing is heard or felt."),
        Answer(
            "sound",
            "There is a tone, a hiss or a breeze.",
            "Starting the array did not silence it: the board did not take the off frames that a start sends.",
            _GRID,
        ),
    ),
)

_CORNERS = (
    Step(
        "corner",
        "One quarter of the array plays. Move a hand or a strip of tissue paper 8 cm above it.",
        "Where is it? Turn the array so that this corner is near you on the left, and leave it so.",
        (
            Answer("corner", "It is above one quarter, which is now near me on the left."),
            Answer(
                "scattered",
                "It is in several places, or nowhere in particular.",
                "Drives reach other transducers than meant: the wiring is another, or it is mixed with its offsets.",
                _WIRING,
            ),
            Answer("none", "Nothing is heard or felt.", "No frame reaches the transducers.", _NOTHING),
        ),
        (FeltStimulus(6.0, corner=(-1, -1)),),
    ),
    Step(
        "corner-x",
        "The next quarter plays, the one at +x.",
        "Where is it, the array standing as before?",
        (
            Answer("near-right", "It is above the quarter near me on the right."),
            Answer(
                "far-left",
                "It is above the far quarter on the left.",
                "The array is mirrored: x and y are exchanged, so its y runs the other way round.",
                _WIRING,
            ),
            Answer("elsewhere", "It is elsewhere, or in several places.", "Columns of transducers are mixed.", _WIRING),
            Answer("none", "Nothing is heard or felt.", "That quarter has no supply, or no data.", "Its cables."),
        ),
        (FeltStimulus(6.0, corner=(1, -1)),),
    ),
    Step(
        "corner-y",
        "The next quarter plays, the one at +y.",
        "Where is it, the array standing as before?",
        (
            Answer("far-left", "It is above the far quarter on the left."),
            Answer(
                "near-right",
                "It is above the quarter near me on the right.",
                "The array is mirrored: x and y are exchanged, so its y runs the other way round.",
                _WIRING,
            ),
            Answer("elsewhere", "It is elsewhere, or in several places.", "Rows of transducers are mixed.", _WIRING),
            Answer("none", "Nothing is heard or felt.", "That quarter has no supply, or no data.", "Its cables."),
        ),
        (FeltStimulus(6.0, corner=(-1, 1)),),
    ),
)

_FOCUS = Step(
    "focus",
    "One focal point plays at x = 30 mm, y = -20 mm, z = 200 mm. Move a flat palm slowly 20 cm above the array.",
    "Where is it strongest, seen from above the middle of the array?",
    (
        Answer("right-near", "It is one point, 3 cm to the right and 2 cm towards me."),
        Answer(
            "right-far",
            "It is one point, to the right and away from me.",
            "y is mirrored, if the array stands by its markings; if by step `corner`, it was moved since.",
            "Step `corner` again, then the wiring. " + _WIRING,
        ),
        Answer(
            "left-near",
            "It is one point, to the left and towards me.",
            "x is mirrored, if the array stands by its markings; if by step `corner`, it was moved since.",
            "Step `corner` again, then the wiring. " + _WIRING,
        ),
        Answer(
            "left-far",
            "It is one point, to the left and away from me.",
            "The array is mirrored, and standing by step `corner` it has x and y exchanged; or it was turned since.",
            "Step `corner` again, then the wiring. " + _WIRING,
        ),
        Answer(
            "weak",
            "It is weak, or in several places.",
            "Transducers work against each other: phase offsets are missing, or are another board's.",
            _OFFSETS,
        ),
        Answer(
            "none",
            "Nothing is felt, though a tone is heard.",
            "The waves do not meet: the sign of the delay is wrong, or the offsets are.",
            "`delays_to` in kernels/driving/pack.py has the sign; the offsets: " + _OFFSETS,
        ),
    ),
    (FeltStimulus(10.0, centre=(0.03, -0.02, 0.2)),),
)

_TURN = Step(
    "turn",
    "A focal point goes round once a second, 2 cm about the middle. Hold a flat palm 20 cm above the array.",
    "Which way does it go, as you look down on the array?",
    (
        Answer("anticlockwise", "It goes anticlockwise."),
        Answer("clockwise", "It goes clockwise.", "The array is mirrored.", _WIRING),
        Answer(
            "jumps",
            "It jumps, or stands still.",
            "Frames are lost, or play in another order.",
            _GRID,
        ),
        Answer("none", "Nothing is felt.", "The waves do not meet.", _OFFSETS),
    ),
    (FeltStimulus(8.0, radius=TURN_RADIUS),),
)

_OFF_ANSWERS = (
    Answer(
        "late",
        "It went on for about a second, then ended.",
        "The program had lost count of the bytes that the board took, so it made the board begin anew, which takes "
        "1.3 s.",
        _GRID,
    ),
    Answer(
        "on",
        "It goes on.",
        "The off frame never became a block of 512 bytes. Switch the supply off now.",
        _GRID,
    ),
)
_OFF = (
    Step(
        "ending",
        "A focal point plays for 3 s and ends. Watch the screen and listen: a line says when it has ended.",
        "Had the sound ended when the line came?",
        (Answer("ended", "It had ended, or ended with the line."), *_OFF_ANSWERS),
        (FeltStimulus(3.0, modulation=HEARD),),
    ),
    Step(
        "stopping",
        "A focal point plays and is stopped after 3 s. Watch the screen and listen: a line says when.",
        "Did the sound end with the line, within a tenth of a second?",
        (
            Answer("ended", "It ended with the line."),
            *_OFF_ANSWERS,
            Answer(
                "crackle",
                "It ended, with a crackle or another sound first.",
                "A frame was torn: the host reports a wrong length for a transfer that was cancelled.",
                (
                    "`QueuedTransport` in device/transports/queued.py; see whether `palpate play --transport sync` "
                    "does it too."
                ),
            ),
        ),
        (FeltStimulus(3.0),),
        act="stop",
    ),
)

_CLOCK = (
    Step(
        "pitch",
        "A focal point hums at 440 Hz. Listen from the side, an arm's length away, or hold a tuner there.",
        "What does it sound like?",
        (
            Answer("a4", "It is an A of 440 Hz, steady."),
            Answer(
                "higher",
                "It is higher.",
                "Frames play faster than they should.",
                "`frame_clock` in device/flat_arrays.py.",
            ),
            Answer(
                "lower",
                "It is lower, or its pitch wavers.",
                "Frames play slower than they should: the board starves, or its clock is another.",
                "The report's `underruns` say which: if they are 0, `frame_clock` in device/flat_arrays.py.",
            ),
            Answer("none", "No tone is heard.", "The board plays one frame only, or none.", _NOTHING),
        ),
        (FeltStimulus(4.0, modulation=HEARD),),
        suits=carries_tones,
    ),
    Step(
        "divider",
        "Two tones follow each other: 440 Hz at the array's own rate, then 444 Hz by every second of 889 frames a "
        "second being silent.",
        "Have both the same pitch?",
        (
            Answer("same", "Both sound alike, the second a little harsher."),
            Answer(
                "higher",
                "The second is much higher.",
                "The board did not take the divider of 45 and plays at its old rate.",
                (
                    "pat16: `with_divider` in device/boards/pat16/kind.py; emulator: `UsbLink.start` in "
                    "device/boards/emulator/link.py."
                ),
            ),
            Answer(
                "lower",
                "The second is lower.",
                "The board took another divider: the order of its bits is another.",
                "pat16: `with_divider` in device/boards/pat16/kind.py.",
            ),
            Answer(
                "first-only",
                "Only the first is heard.",
                "Every second frame is lost: those that are silent, or those that are not.",
                _GRID,
            ),
            Answer("none", "No tone is heard.", "The board plays one frame only, or none.", _NOTHING),
        ),
        (FeltStimulus(4.0, modulation=HEARD), FeltStimulus(4.0, modulation=None, divider=SLOW_DIVIDER)),
        suits=carries_tones,
    ),
    Step(
        "fast",
        "A focal point hums at 440 Hz for 10 s at 13.3 kHz, the fastest that the FT232H should carry.",
        "What does it sound like?",
        (
            Answer("steady", "It is the same steady tone as in step `pitch`."),
            Answer(
                "starved",
                "It is lower, rough, or has gaps.",
                "The chip passes on fewer than 6.8 MB/s, so the board starves at divider 3.",
                "`divider_sustained` in device/boards/pat16/kind.py: 4. Until then `--update-rate 10000` at most.",
            ),
            Answer("none", "No tone is heard.", "The board plays one frame only, or none.", _NOTHING),
        ),
        (FeltStimulus(10.0, modulation=HEARD, divider=3),),
        suits=is_behind_a_chip,
    ),
    Step(
        "minute",
        "A focal point hums at the array's own rate for a minute. Read what the counters say afterwards.",
        "How was it?",
        (
            Answer("steady", "It was steady, and the counters are 0 underruns and all frames."),
            Answer(
                "counted",
                "It was steady, but the counters have underruns or fewer frames.",
                "The host was late by the player's estimate: another program, power saving, or a hub in between.",
                (
                    "Another USB port, no hub; `WINDOW_DURATION` in device/transports/stream.py is how late the "
                    "host may be."
                ),
            ),
            Answer(
                "gaps",
                "It had gaps or crackled.",
                "The board starved, or frames were torn.",
                "With underruns as for `counted`. Without: " + _GRID,
            ),
            Answer(
                "stopped",
                "It ended early.",
                "The supply, the cable or the board's heat.",
                "The supply's current limit; the report's `failure`; then play with `--on-time-max 30`.",
            ),
        ),
        (FeltStimulus(60.0, modulation=HEARD),),
    ),
)

_PLUG = (
    Step(
        "unplug",
        "A focal point plays. Pull the USB plug within 30 s, and leave it out. Have a hand on the supply's switch.",
        "What happened when you pulled it?",
        (
            Answer("silent", "The array fell silent, and the program said that it is gone."),
            Answer(
                "on",
                "The sound went on.",
                "The board has a supply of its own, and plays its last frame on without a host. Switch its supply off.",
                (
                    "Nothing that software can do; the emulated board differs, in `Port.unplug` of "
                    "device/emulation/usb_bus.py."
                ),
            ),
            Answer(
                "unnoticed",
                "The array fell silent, but the program played to its end.",
                "The host takes bytes for a device that is gone.",
                "`_MEANING` in device/errors.py: the number that this host gives for it is missing there.",
            ),
        ),
        (FeltStimulus(30.0),),
        act="unplug",
        suits=has_plug,
    ),
    Step(
        "replug",
        "Plug it in again, and switch its supply on. The array is waited for; then the focal point of step `focus` "
        "plays.",
        "Is it felt as in step `focus`?",
        (
            Answer("again", "It is felt in the same place."),
            Answer(
                "elsewhere",
                "It is weak, or elsewhere.",
                "A frame was torn by the plug, and the board counts from the wrong byte since then.",
                _GRID,
            ),
            Answer(
                "none",
                "Nothing is felt.",
                "The board was not ready: it takes no frame in the first second after it gets its power.",
                (
                    "`SETTLING` in render/selftest/board.py: longer. If it helps, `PatLink` in "
                    "device/boards/pat16/link.py needs it."
                ),
            ),
        ),
        (FeltStimulus(6.0, centre=(0.03, -0.02, 0.2)),),
        act="replug",
        suits=has_plug,
    ),
)

STEPS: tuple[Step, ...] = (_SILENT, *_CORNERS, _FOCUS, _TURN, *_OFF, *_CLOCK, *_PLUG)
"""All steps, in the order in which they are asked: what a later one rests on comes before it."""
