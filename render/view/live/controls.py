"""The panel at the side of the page: timeline, layers, pressure; what the visitor does comes out as tasks."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import viser

from ..pressure_print import PLACES
from .scene_nodes import LAYERS
from .shared_clock import SPEEDS

PLAY, PAUSE = "play", "pause"
STEPS = {"first": "first", "-1": -1, "+1": 1, "last": "last"}


@dataclass(frozen=True)
class Actions:
    """What the viewer does when the visitor asks for it; each returns at once."""

    seek: Callable[[int], None]
    """Go to a pose of the first file."""
    step: Callable[[int], None]
    """Go so many poses on."""
    toggle: Callable[[], None]
    """Play, or stop playing."""
    set_speed: Callable[[float], None]
    set_layer: Callable[[str, bool], None]
    set_pressure: Callable[[str], None]
    predict_noise: Callable[[], None]


class Controls:
    """Makes the panel's inputs and shows the timeline's state in them."""

    def __init__(self, server: viser.ViserServer, pose_count: int, actions: Actions) -> None:
        self._count = pose_count
        gui = server.gui
        with gui.add_folder("timeline"):
            self._slider = gui.add_slider("pose", 0, max(pose_count - 1, 1), 1, 0, disabled=pose_count < 2)
            steps = gui.add_button_group("step", tuple(STEPS))
            self._play = gui.add_button(PLAY)
            speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="1")
        tabs = gui.add_tab_group()
        self.plots = tabs.add_tab("plots")
        """Where plots go."""
        with tabs.add_tab("show"):
            layers = {name: gui.add_checkbox(name, True) for name in LAYERS}
        self.predict = tabs.add_tab("predict")
        """Where predictions go."""
        with self.predict:
            pressure = gui.add_dropdown("pressure", PLACES, initial_value="off")
            self.scale = gui.add_html("")
            """What the colours of pressure mean."""
            noise = gui.add_button("noise around this moment")
            self.noise = gui.add_html("")
            """Levels of noise."""
        self._slider.on_update(_from_visitor(lambda h: actions.seek(int(h.value))))
        steps.on_click(_from_visitor(lambda h: self._step(h.value, actions)))
        self._play.on_click(_from_visitor(lambda _: actions.toggle()))
        speed.on_update(_from_visitor(lambda h: actions.set_speed(SPEEDS[h.value])))
        pressure.on_update(_from_visitor(lambda h: actions.set_pressure(h.value)))
        noise.on_click(_from_visitor(lambda _: actions.predict_noise()))
        for name, box in layers.items():
            box.on_update(_from_visitor(lambda h, name=name: actions.set_layer(name, h.value)))

    def _step(self, choice: str, actions: Actions) -> None:
        step = STEPS[choice]
        if isinstance(step, int):
            actions.step(step)
        else:
            actions.seek(0 if step == "first" else self._count - 1)

    def show(self, pose: int, *, is_playing: bool) -> None:
        """Show the pose of the first file, and whether it plays."""
        self._slider.value = pose
        self._play.label = PAUSE if is_playing else PLAY


def _from_visitor(act: Callable[[Any], None]) -> Callable[[viser.GuiEvent[Any]], None]:
    """Have an input act when a visitor changes it, and not when the viewer shows its own state in it."""

    def on_event(event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:
            act(event.target)

    return on_event
