"""A Python script that plays focal points on an AUTD3 as focus STM, with the vendor's package alone.

The array computes the phases itself and shows the focal points by its own clock, so the rate holds whatever the host
does.
"""

import base64
import re
import textwrap
import zlib
from importlib.metadata import version
from pathlib import Path

import numpy as np

from ...device.errors import UpdateRateError
from ...device.registry import array_model
from ..errors import StrategyError
from ..playback.drive import DriveStrategy
from .focal_points import FocusFormat, SampledFocus

CAPACITY = 65_536  # focal points that the array's memory holds
COUNT_LEAST = 2
OWNER = "the focus STM of an AUTD3"
CORNER = (-86.36, -66.04, 0.0)  # [mm] transducer 0, where the vendor has its origin, in the array's frame
_LINE = 110


def require_rate(update_rate: float) -> int:
    """The divider of 40 kHz that makes an update rate [Hz]; raises StrategyError where none does."""
    try:
        return array_model("autd3").divider(update_rate)
    except UpdateRateError as error:
        raise StrategyError(str(error)) from error


def write_script(temporary: Path, source: Path, sampled: SampledFocus) -> int:
    """Write a script that plays focal points; returns how many it silences as the array cannot focus there.

    source: of the focal points, for the script's reader. Raises OSError, and StrategyError for a rate that the array
    does not take, and for fewer focal points than two.
    """
    model, focus = array_model("autd3"), sampled.focus
    divider = require_rate(sampled.update_rate)
    if len(focus.intensity) < COUNT_LEAST:
        raise StrategyError(f"{source}: {len(focus.intensity)} focal point, but {OWNER} plays {COUNT_LEAST} at least")
    lost = (focus.intensity > 0) & ~model.in_reach(focus.position)
    intensity = np.where(lost, np.float32(0), focus.intensity)
    rows = np.column_stack([focus.position, intensity]).astype("<f4")
    data = base64.b64encode(zlib.compress(rows.tobytes(), 9)).decode()
    values = {
        "VERSION": version("palpate"),
        "SOURCE": ascii(str(source)),
        "COUNT": str(len(rows)),
        "DIVIDER": str(divider),
        "RATE": f"{sampled.update_rate:g}",
        "SOUND_SPEED": repr(DriveStrategy().sound_speed),
        "CORNER": repr(list(CORNER)),
        "DATA": "\n".join(textwrap.wrap(data, _LINE)),
    }
    text = re.sub(r"@([A-Z_]+)@", lambda found: values[found[1]], _SCRIPT)  # in one pass: a source's name may hold one
    temporary.write_bytes(text.encode())
    return int(np.count_nonzero(lost))


AUTD3 = FocusFormat(OWNER, CAPACITY - 1, require_rate)  # the last focal point switches it off

_SCRIPT = '''"""Plays focal points on an AUTD3 as focus STM. Made by palpate @VERSION@.

It needs: pip install autd3==0.12.0 numpy

    python SCRIPT.py                    plays once on the array that is found
    python SCRIPT.py --interface eth1   the array at this network interface
    python SCRIPT.py --loop             again and again, until Ctrl-C
    python SCRIPT.py --emulate          the vendor's emulated array

However it ends, the array is silent: this script stops it, and without a host it stops by itself after 0.5 s.
"""

import argparse
import asyncio
import base64
import zlib

import numpy as np
from autd3 import Client, ClientConfig, Duration, Interface, UdpEmulator, UdpOption, commands
from autd3.geometry import Autd3, Geometry
from autd3.units import Velocity
from autd3.value import ControlPoint, ControlPoints, LoopBehavior, PatternBank, SamplingConfig, TransitionMode

SOURCE = @SOURCE@  # whose contours were sampled
COUNT = @COUNT@  # focal points
DIVIDER = @DIVIDER@  # of 40 kHz: @RATE@ focal points a second
SOUND_SPEED = @SOUND_SPEED@  # [m/s]
CORNER = @CORNER@  # [mm] transducer 0 in the frame of the focal points: its origin is the middle of the array's face


def focal_points():
    """x, y, z [m] (z away from the array) and intensity (pressure, 0 to 1) of each, float32, shape [point, 4]."""
    return np.frombuffer(zlib.decompress(base64.b64decode(DATA)), "<f4").reshape(COUNT, 4)


def geometry():
    """One array, whose face has its middle in the origin."""
    return Geometry([Autd3(origin=CORNER)])


def preparation():
    """Nothing of earlier plays; no smoothing, which would lag behind the focal points; off if the host dies."""
    failsafe = commands.CpuConfig(failsafe_timeout=Duration.from_millis(500))
    unsmoothed = commands.SetSilencer(commands.FixedUpdateRate(65535, 65535))
    return [commands.Clear(), unsmoothed, commands.SetCpuConfig(failsafe)]


def stm(loop=False):
    """The focal points for the array's second bank. Played once they end with silence; a loop has no place for it."""
    points = [
        ControlPoints([ControlPoint([1e3 * x, 1e3 * y, 1e3 * z], 0)], round(255 * level))
        for x, y, z, level in focal_points().tolist()
    ]
    if not loop:
        points.append(ControlPoints(points[-1].points, 0))
    option = commands.FociStmOption(
        bank=PatternBank.B1,
        sound_speed=Velocity.from_m_s(SOUND_SPEED),
        loop_behavior=LoopBehavior.Infinite if loop else LoopBehavior.Once,
        transition_mode=TransitionMode.Later,
    )
    return commands.FociStm(SamplingConfig(DIVIDER), points, option)


async def play(interface=None, loop=False, emulate=False):
    """Play on an array; it is silent when this returns."""
    emulator = UdpEmulator(1) if emulate else None
    where = Interface.Auto if interface is None else Interface.Name(interface)
    link = UdpOption(iface=where if emulator is None else emulator.option().iface)
    client = await Client.open(geometry(), link, ClientConfig(require_supported_firmware=True))
    try:
        await client.send(preparation())
        await client.send(stm(loop))
        start = client.device_time_now() + Duration.from_millis(50)
        when = TransitionMode.Immediate if loop else TransitionMode.SysTime(start)
        await client.send(commands.ActivatePatternBank(PatternBank.B1, when))
        seconds = COUNT * DIVIDER / 40e3
        print(f"plays {COUNT} focal points, {seconds:g} s" + (", until Ctrl-C" if loop else ""), flush=True)
        await (asyncio.Event().wait() if loop else asyncio.sleep(seconds + 0.1))
    finally:
        await client.silent_stop()
        await client.close()


DATA = """
@DATA@
"""

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Play focal points on an AUTD3.")
    parser.add_argument("--interface", help="network interface of the array, as eth1")
    parser.add_argument("--loop", action="store_true", help="play again and again, until Ctrl-C")
    parser.add_argument("--emulate", action="store_true", help="play on the vendor's emulated array")
    try:
        asyncio.run(play(**vars(parser.parse_args())))
    except KeyboardInterrupt:
        pass
'''
