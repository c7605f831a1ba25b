"""The parent's side of a process that draws: what is said of a slow object, and that nothing is left behind."""

import os
from types import SimpleNamespace

import pytest

from palpate.device import array_model
from palpate.device.registry import kind_of
from palpate.render import Palm, SamplingStrategy
from palpate.render.errors import RenderError, StrategyError
from palpate.render.intersection.named_inputs import solid_of
from palpate.render.live import drawing_run
from palpate.render.live.drawing_run import RendererHandle, slow_text
from palpate.render.live.renderer_process import LiveRendering
from palpate.render.playback.drive import DriveStrategy
from palpate.render.strategies.intersection_strategy import strategy_of


def test_an_object_that_takes_more_than_half_of_the_lead_is_told_with_its_figure():
    assert slow_text("tube", 2.9e-3, 6e-3) is None
    text = slow_text("tube", 4.2e-3, 6e-3)
    for part in ("a pose of tube takes 4.2 ms here", "go out 6 ms ahead", "lead=0.0084"):
        assert part in text


def writer():
    model = array_model("emulator")
    return SimpleNamespace(
        arrays=[SimpleNamespace(kind=kind_of(model), model=model)],
        pace=SimpleNamespace(lead=6e-3),
        slice_frames=40,
        ring=SimpleNamespace(fd=0),
        wake_fd=0,
    )


def handle(drive=None, **fields):
    rendering = LiveRendering(
        solid=solid_of("cube"),
        hand=Palm(),
        strategy=strategy_of("cc"),
        sampling=SamplingStrategy(),
        drive=drive or DriveStrategy(),
    )
    fields = {"pose_fd": 0, "numbers": range(100), "intensity": 1.0, "realtime": False, "is_recorded": True} | fields
    return RendererHandle([rendering], writer(), **fields)


@pytest.mark.parametrize("fault", ["start", "pickle"])
def test_a_process_that_is_not_started_leaves_no_descriptor(monkeypatch, fault):
    def refuse(*_):
        raise OSError("no more processes")

    handle_of = {"start": lambda: handle(), "pickle": lambda: handle(drive=lambda: 0)}[fault]
    monkeypatch.setattr(drawing_run, "start_process", refuse)
    open_before = os.listdir("/proc/self/fd")
    with pytest.raises(OSError if fault == "start" else StrategyError):
        handle_of()
    assert len(os.listdir("/proc/self/fd")) == len(open_before)


def messages_of(*messages):
    return lambda self, timeout=0.0: iter(messages)


@pytest.mark.parametrize(
    ("message", "error", "sentence"),
    [
        ({"event": "failed", "kind": "MeshError", "text": "no inside"}, "MeshError", "no inside"),
        ({"event": "failed", "kind": "KeyError", "text": "'x'"}, "StrategyError", "'x'"),
        ({"event": "gone"}, "StrategyError", "ended before it was ready"),
    ],
)
def test_what_a_process_failed_with_is_raised(monkeypatch, message, error, sentence):
    monkeypatch.setattr(drawing_run, "start_process", lambda *_: SimpleNamespace())
    monkeypatch.setattr(RendererHandle, "messages", messages_of(message))
    own = handle()
    with pytest.raises(RenderError, match=sentence) as raised:
        own.await_ready()
    own.release()
    assert type(raised.value).__name__ == error
