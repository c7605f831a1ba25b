"""The participant's page: what the desk shows, the object, and the own hand; and the keys that it hands back."""

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ....device.errors import DeviceError
from ...errors import RenderError, StrategyError, StudyError
from ...live.moment import LiveMoment, LiveScene
from ...terminal.foreign_text import visible
from ...view.packing import Packer
from ...view.page.payload import simplified_for_display
from ...view.served.page_server import PageRequest, Send
from ..plan.study_plan import Answer, Question
from ..run.desk import Screen, ShownObject, StudyDesk

LOWEST = 20.0  # [Hz]: below it nothing is heard, and a headset is only moved


def pink_noise(seconds: float, rate: float, seed: int, level: float) -> np.ndarray:
    """Noise whose power falls by 10 dB a decade from 20 Hz on, float32, shape [sample]; its peak is `level`, 0..1.

    It is made as a sum of whole periods of its own duration, so that its end continues with its beginning: a loop has
    no click. Raises StrategyError for a duration without a period of 20 Hz, and for a rate or level out of bounds.
    """
    if not 0.1 <= seconds <= 60.0:
        raise StrategyError(f"seconds of noise must be from 0.1 to 60, not {seconds:g}")
    if not 8_000.0 <= rate <= 192_000.0:
        raise StrategyError(f"the rate of noise must be from 8000 to 192000 Hz, not {rate:g}")
    if not 0.0 <= level <= 1.0:
        raise StrategyError(f"the level of noise must be from 0 to 1, not {level:g}")
    count = round(seconds * rate)
    frequency = np.fft.rfftfreq(count, 1 / rate)
    amplitude = np.where(frequency >= LOWEST, np.maximum(frequency, LOWEST) ** -0.5, 0.0)
    phase = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, len(frequency))
    wave = np.fft.irfft(amplitude * np.exp(1j * phase), count)
    scaled = (wave * (level / np.abs(wave).max())).astype(np.float32)
    return np.clip(scaled, -np.float32(level), np.float32(level))


NUMBER_MOST = 2**53  # up to which browsers count exactly
SECONDS_MOST = 1e7  # from a screen to an answer
WAIT_MOST = 0.5  # [s] that an answer may be waited with
NOISE_SECONDS = 10.0  # of the loop
TEXT_MOST = 10_000  # characters
TEXT_NAMES = ("text", "title", "hint")
QUESTION_NAMES = ("kind", "point_count", "low_text", "high_text", "low", "high", "is_optional")
SOUNDS = {
    "off": "no key was pressed yet: the browser allows no sound before",
    "ready": "ready",
    "playing": "playing",
    "blocked": "blocked by the browser",
    "missing": "no sound card",
}
"""States of the masking noise as the page reports them, and as the experimenter reads them."""

MeshOf = Callable[[ShownObject], tuple[np.ndarray, np.ndarray]]
"""Vertices, float32, shape [vertex, 3], in the array's frame [m], and faces, shape [face, 3], of an object."""


class ParticipantPage:
    """What all visits of the participant's page share. One visit at a time has the page; the desk refuses others.

    scene, moment: `Session.scene` and `Session.moment`; nothing of them but the hand's shape and pose is sent.
    mesh: gives what is drawn of an object. noise_level: peak of the masking noise, 0..1 of full scale.
    """

    def __init__(
        self,
        desk: StudyDesk,
        scene: Callable[[], LiveScene | None],
        moment: Callable[[], LiveMoment | None],
        mesh: MeshOf,
        *,
        noise_level: float = 0.0,
        noise_seed: int = 0,
    ) -> None:
        self.desk = desk
        self.sound = "off"
        """State of the masking noise, as the page reported it last: a name of SOUNDS."""
        self._scene, self._moment, self._mesh = scene, moment, mesh
        self._noise = noise_seed, noise_level
        self._owning, self._loading = threading.Lock(), threading.Lock()
        self._owner: ParticipantVisit | None = None
        self._page_number = 0
        self._objects: dict[ShownObject, tuple[int, np.ndarray, np.ndarray]] = {}
        self._hand_arrays: tuple[np.ndarray, np.ndarray] | None = None
        self._hand_number = 0
        self._last_scene: LiveScene | None = None

    def __repr__(self) -> str:
        """One line."""
        return f"ParticipantPage(sound {self.sound})"

    def visit(self) -> "ParticipantVisit":
        """Begin a conversation with a browser."""
        return ParticipantVisit(self)

    def own(self, visit: "ParticipantVisit") -> None:
        """Give the page to a visit; raises StudyError while another one has it.

        A visit that has not asked for LOST_SECONDS loses it to the next one, and is refused itself from then on.
        """
        with self._owning:
            if self._owner is visit and self.desk.is_open(self._page_number):
                return
            self._page_number = self.desk.open_page()
            self._owner = visit

    def disown(self, visit: "ParticipantVisit") -> None:
        """Close the page at the desk, if this visit has it."""
        with self._owning:
            if self._owner is visit:
                self._owner = None
                self.desk.close_page(self._page_number)

    def report_sound(self, sound: str) -> None:
        """Show the experimenter another state of the masking noise."""
        if sound != self.sound or "sound" not in self.desk.status():
            self.sound = sound
            self.desk.set_status(sound=SOUNDS[sound])

    def object_of(self, shown: ShownObject) -> tuple[int, np.ndarray, np.ndarray]:
        """Number, vertices and faces of an object, which is loaded once."""
        same = replace(shown, opacity=1.0, has_hand=False)  # one mesh, however it is drawn
        with self._loading:
            if same not in self._objects:
                vertices, faces, _ = simplified_for_display(*self._mesh(shown))
                self._objects[same] = (len(self._objects) + 1, vertices, faces)
            return self._objects[same]

    def hand_of(self, scene: LiveScene | None) -> tuple[int, np.ndarray, np.ndarray]:
        """Number, vertices and faces of the hand's mesh in its own frame; the number changes with the mesh."""
        with self._loading:
            if scene is not None and scene is not self._last_scene:
                arrays = scene.hand_vertices, scene.hand_faces
                known = self._hand_arrays
                if known is None or not all(map(np.array_equal, arrays, known)):
                    self._hand_arrays = arrays
                    self._hand_number += 1
                self._last_scene = scene
            if self._hand_arrays is None:
                return 0, np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)
            return self._hand_number, *self._hand_arrays

    def scene(self) -> LiveScene | None:
        """Of the session, for the hand's mesh; None where it has none."""
        return self._scene()

    def moment(self) -> LiveMoment | None:
        """What is drawn now; None where nothing is, or the session cannot say: the screen matters more."""
        with contextlib.suppress(RenderError, DeviceError):
            return self._moment()
        return None

    def noise(self, rate: float) -> np.ndarray:
        """A loop of masking noise."""
        return pink_noise(NOISE_SECONDS, rate, *self._noise)


class ParticipantVisit:
    """Answers one browser that shows the participant's page.

    | a page asks | it gets |
    |---|---|
    | screen: `after`, the number of the screen that it shows; `sound`; `wait` [s] | a newer screen, else its number; where the hand is |
    | object | meshes of the object that is shown and of the hand |
    | noise: `rate` [Hz] | a loop of masking noise |
    | press: `screen`, `key`, `seconds` | whether it counts |
    | give: `screen`, `value`, `seconds` | whether it counts; of a value that the question does not take, why |

    `wait`: the answer comes so much later, for a page whose timers the browser slows down as it is hidden.
    """  # noqa: E501

    slow = frozenset({"screen", "object", "noise", "press", "give"})
    """All of them: none waits for what the experimenter's page asks, and the other way round."""

    def __init__(self, page: ParticipantPage) -> None:
        self._page, self._desk = page, page.desk

    def close(self) -> None:
        """The browser has closed the page, or its connection was lost."""
        self._page.disown(self)

    def answer(self, request: PageRequest, send: Send) -> None:
        """Answer one request; raises StudyError while another browser has the page, StrategyError for a wrong one."""
        self._page.own(self)
        packer = Packer(exact=True)
        match request.choice("ask", tuple(sorted(self.slow))):
            case "screen":
                described = self._screen(request, packer)
            case "object":
                described = self._object(packer)
            case "noise":
                loop = self._page.noise(request.number("rate", 8_000, 192_000))
                described = {"kind": "noise", "samples": packer.numbers(loop, "f4")}
            case "press":
                if not (key := request.text("key", 40)):
                    raise StrategyError("key must be a text of 1 to 40 characters, not ''")
                is_counted = self._desk.press(_screen_number(request), key, _seconds(request))
                described = {"kind": "press", "counts": is_counted}
            case _:
                described = {"kind": "give", "counts": self._give(request)}
        send(described, packer)

    def _give(self, request: PageRequest) -> bool:
        refusal = self._desk.shown.refusal
        try:
            return self._desk.give(_screen_number(request), _value(request), _seconds(request))
        except StudyError as error:
            raise StudyError(refusal or str(error)) from error

    def _screen(self, request: PageRequest, packer: Packer) -> dict[str, Any]:
        after = request.number("after", -1, NUMBER_MOST)
        if request.has("sound"):
            self._page.report_sound(request.choice("sound", tuple(SOUNDS)))
        if request.has("wait"):
            time.sleep(request.number("wait", 0, WAIT_MOST))
        screen = self._desk.screen()
        described: dict[str, Any] = {"kind": "screen", "number": screen.number}
        if screen.number != after:
            described["screen"] = self._described(screen)
        if screen.ends is not None:
            described["left"] = max(0.0, screen.ends - self._desk.clock.now())
        if screen.kind == "stimulus" and screen.shown is not None and screen.shown.has_hand:
            described["hand"] = self._hand(packer)
        return described

    def _described(self, screen: Screen) -> dict[str, Any]:
        """What the page shows of a screen: neither the answers that keys give, nor names of questions and files."""
        shown = screen.shown
        return {
            "kind": screen.kind,
            **{name: visible_lines(getattr(screen, name)) for name in TEXT_NAMES},
            "keys": [{"key": own.key, "label": visible_lines(own.label)} for own in screen.keys],
            "question": None if screen.question is None else _described_question(screen.question),
            "shown": None if shown is None else {"number": self._page.object_of(shown)[0], "opacity": shown.opacity},
            "has_noise": screen.has_noise,
            "progress": screen.progress,
        }

    def _hand(self, packer: Packer) -> dict[str, Any] | None:
        moment = self._page.moment()
        if moment is None or moment.hand is None or moment.hand_pose is None or moment.state == "faded":
            return None
        if not np.isfinite(moment.hand_pose).all():
            return None
        number, vertices, _ = self._page.hand_of(moment.scene)
        patches = np.zeros((0, 4, 3), np.float32) if len(vertices) else moment.hand.patches
        return {
            "number": number,
            "pose": packer.numbers(moment.hand_pose, "f4"),
            "patches": packer.numbers(patches.reshape(-1, 3), "f4"),
        }

    def _object(self, packer: Packer) -> dict[str, Any]:
        shown = self._desk.screen().shown
        hand_number, hand_vertices, hand_faces = self._page.hand_of(self._page.scene())
        described: dict[str, Any] = {
            "kind": "object",
            "hand": {
                "number": hand_number,
                "vertices": packer.numbers(hand_vertices, "f4"),
                "faces": packer.numbers(hand_faces, "u4"),
            },
        }
        if shown is not None:
            number, vertices, faces = self._page.object_of(shown)
            described["object"] = {
                "number": number,
                "vertices": packer.numbers(vertices, "f4"),
                "faces": packer.numbers(faces, "u4"),
            }
        return described


def visible_lines(text: str) -> str:
    """Foreign text of several lines without characters that a screen obeys."""
    return "\n".join(visible(line) for line in text.splitlines())


def _described_question(question: Question) -> dict[str, Any]:
    described = {name: getattr(question, name) for name in QUESTION_NAMES}
    described |= {name: visible(getattr(question, name)) for name in ("low_text", "high_text")}
    return described | {"text": visible_lines(question.text)}


def _screen_number(request: PageRequest) -> int:
    return int(request.number("screen", 0, NUMBER_MOST))


def _seconds(request: PageRequest) -> float:
    return float(request.number("seconds", 0, SECONDS_MOST))


def _value(request: PageRequest) -> Answer:
    """What was typed, as the store takes it; whether the question takes it, the desk judges."""
    value = request.values.get("value")
    if isinstance(value, str):
        if len(value) > TEXT_MOST:
            raise StudyError(f"the answer must have at most {TEXT_MOST} characters, not {len(value)}")
        return value.encode("utf-8", "replace").decode()  # half of a character, which no file takes, becomes "?"
    if value is None:
        return None
    number = request.number("value", -1e300, 1e300)
    return number if isinstance(number, int) and abs(number) <= NUMBER_MOST else float(number)
