"""Events as LSL markers: at the array's time on LSL's clock; with the real pylsl where it is, and with one of ours."""

import json
import sys
import time
import uuid
from importlib import import_module
from types import SimpleNamespace

import pytest

from palpate.render.errors import StudyError
from palpate.render.study.run.desk import StudyDesk
from palpate.render.study.run.event_stream import EventStream, LslOutlet


class FakeLsl:
    """What the outlet takes of pylsl 1.18, with a clock that runs 1000 s ahead of the array's."""

    IRREGULAR_RATE, cf_string = 0.0, 3

    def __init__(self):
        self.info, self.pushed = None, []

    def StreamInfo(self, name, type, channel_count, nominal_srate, channel_format, source_id):
        return (name, type, channel_count, nominal_srate, channel_format, source_id)

    def StreamOutlet(self, info):
        self.info = info
        return SimpleNamespace(push_sample=lambda x, timestamp: self.pushed.append((x, timestamp)))

    def local_clock(self):
        return time.monotonic() + 1000


def test_each_event_is_a_marker_at_its_own_time_on_lsls_clock(monkeypatch):
    fake = FakeLsl()
    monkeypatch.setitem(sys.modules, "pylsl", fake)
    outlet = LslOutlet("pilot")
    assert fake.info == ("pilot", "Markers", 1, 0.0, 3, "palpate pilot")
    assert repr(outlet) == "LslOutlet('pilot')"
    with EventStream(StudyDesk(), port=None, token="t", outlet=outlet) as stream:
        stream.send("stimulus_onset", array_time=2.5, stimulus="cc")
    ((line,), timestamp) = fake.pushed[0]
    assert json.loads(line)["stimulus"] == "cc"
    assert timestamp == pytest.approx(1002.5, abs=1e-3)


@pytest.mark.exhaustive
def test_a_recorder_on_this_machine_gets_events_at_the_arrays_time():
    """Finding a stream takes LSL tenths of seconds, and its threads CPU."""
    try:
        pylsl = import_module("pylsl")
    except (ImportError, RuntimeError) as error:  # RuntimeError: it is installed without its library
        pytest.skip(f"pylsl cannot be imported here: {error}")
    assert abs(pylsl.local_clock() - time.monotonic()) < 1e-3  # the same clock, on Linux
    name = f"palpate test {uuid.uuid4()}"  # other machines of this network may run this test, too
    outlet = LslOutlet(name)
    found = pylsl.resolve_byprop("name", name, timeout=5)
    if not found:
        pytest.skip("LSL finds no stream of this machine: its multicast is cut off")
    inlet = pylsl.StreamInlet(found[0])
    inlet.open_stream(timeout=5)
    assert outlet._outlet.wait_for_consumers(5)  # LSL sends nobody what was pushed before
    with EventStream(StudyDesk(), port=None, token="t", outlet=outlet) as stream:
        times = [time.monotonic() - 0.25 * number for number in range(20)]
        for number, array_time in enumerate(times):
            stream.send("stimulus_onset", array_time=array_time, number=number, text="größer")
        for number, array_time in enumerate(times):
            (line,), timestamp = inlet.pull_sample(timeout=5)
            event = json.loads(line)
            assert (event["number"], event["text"], event["array_time"]) == (number, "größer", array_time)
            assert timestamp - (pylsl.local_clock() - time.monotonic()) == pytest.approx(array_time, abs=1e-3)
    info = inlet.info(timeout=5)
    assert (info.type(), info.channel_count(), info.nominal_srate()) == ("Markers", 1, 0.0)
    inlet.close_stream()


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (None, "needs pylsl, which is not installed"),
        ("raise RuntimeError('LSL binary library file was not found.\\nMore')", r"liblsl \(LSL binary .* found\.\): "),
        ("raise OSError('liblsl.so: \\x1b[2J')", r"liblsl \(liblsl\.so: \\x1b\[2J\): "),
    ],
)
def test_a_missing_library_is_refused_with_the_command_that_installs_it(monkeypatch, tmp_path, code, text):
    if code is None:
        monkeypatch.setitem(sys.modules, "pylsl", None)
    else:  # it is installed, and cannot be imported
        monkeypatch.delitem(sys.modules, "pylsl", raising=False)
        monkeypatch.syspath_prepend(tmp_path)
        (tmp_path / "pylsl.py").write_text(code)
    with pytest.raises(StudyError, match=text) as refused:
        LslOutlet("pilot")
    assert "pip install 'palpate[lsl]'" in str(refused.value)


@pytest.mark.parametrize("name", ["", "x" * 101, "a\nb", "\x1b[2J"])
def test_a_name_that_others_could_not_show_is_refused(name):
    with pytest.raises(StudyError, match="must be a text of 1 to 100 characters"):
        LslOutlet(name)
