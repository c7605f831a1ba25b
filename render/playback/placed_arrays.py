"""Arrays of a playback and their poses: one array by name, or several from a JSON file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...datasets.json_text import read_json
from ...datasets.known_names import unknown_name
from ...device.array import ArrayModel
from ...device.registry import array_model
from ..errors import StrategyError

FIELDS = ("array", "serial", "calibration", "baud", "pose")
ARRAYS_MOST = 127  # devices that a USB bus can have


@dataclass(frozen=True)
class PlacedArray:
    """One array of a playback.

    >>> from palpate.device import array_model
    >>> from palpate.render import PlacedArray
    >>> above = PlacedArray(array_model("emulator").placed([0, 0, 0.4, 1, 0, 0, 0]))  # half a turn about x: face down
    >>> above.model.normal[0]
    array([ 0.,  0., -1.], dtype=float32)
    """

    model: ArrayModel
    """The array with its calibration and its pose in the common frame."""
    serial: str | None = None
    """Serial number; for autd3 the network interface or address. None: the first array found."""


def load_rig(
    source: str, *, serial: str | None = None, calibration: Path | None = None, baud: int | None = None
) -> tuple[PlacedArray, ...]:
    """Arrays by the name of one, or from a JSON file with a list of objects.

    The file's objects have `array` and, where needed, `serial`, `calibration` (a board file, beside the JSON file if
    its path is relative), `baud`, and `pose`: x y z [m] and quaternion xyzw of the array's frame in the common one.
    Raises StrategyError for an invalid file, naming field and value; DeviceError for unknown arrays.

    >>> from pathlib import Path
    >>> from palpate.render import load_rig
    >>> _ = Path("rig.json").write_text('[{"array": "pat16"}, {"array": "pat16", "pose": [0, 0, 0.4, 1, 0, 0, 0]}]')
    >>> [placed.model.normal[0, 2].item() for placed in load_rig("rig.json")]  # one faces up, one down
    [1.0, -1.0]
    """
    if not source.endswith(".json"):
        return (PlacedArray(array_model(source, calibration=calibration, baud=baud), serial),)
    path = Path(source)
    try:
        entries = read_json(path)
    except OSError as error:
        raise StrategyError(f"{path}: cannot be read ({error.strerror or error})") from error
    except ValueError as error:
        raise StrategyError(f"{path}: not JSON ({error})") from error
    if not isinstance(entries, list) or not entries:
        raise StrategyError(
            f"{path}: must be a list of at least one array, not {'empty' if entries == [] else entries!r}"
        )
    if len(entries) > ARRAYS_MOST:
        raise StrategyError(f"{path}: lists {len(entries):,} arrays, more than the {ARRAYS_MOST} devices of a USB bus")
    if serial or calibration or baud:
        raise StrategyError(f"{path}: names its arrays' serial numbers, board files and baud rates itself")
    return tuple(_placed(entry, path, index) for index, entry in enumerate(entries))


def arrays_of(array: str | Sequence[PlacedArray]) -> tuple[PlacedArray, ...]:
    """Arrays that are given, or named as for `load_rig`."""
    return load_rig(array) if isinstance(array, str) else tuple(array)


def with_points(arrays: Sequence[PlacedArray], point_count: int) -> tuple[PlacedArray, ...]:
    """The arrays, those that take focal points with frames of so many."""
    return tuple(replace(placed, model=placed.model.with_points(point_count)) for placed in arrays)


def _placed(entry: object, path: Path, index: int) -> PlacedArray:
    where = f"{path}: array {index}"
    if not isinstance(entry, dict):
        raise StrategyError(f"{where} must be a JSON object, not {type(entry).__name__}")
    unknown = sorted(set(entry) - set(FIELDS))
    if unknown:
        raise StrategyError(f"{where}: " + unknown_name("field", unknown[0], FIELDS))
    for name, kind in (("array", str), ("serial", str), ("calibration", str), ("baud", int), ("pose", list)):
        if not isinstance(entry.get(name), kind) and not (name != "array" and entry.get(name) is None):
            raise StrategyError(f"{where}: {name} must be a {kind.__name__}, not {entry.get(name)!r}")
    file = entry.get("calibration")
    model = array_model(
        entry["array"], calibration=None if file is None else path.parent / file, baud=entry.get("baud")
    )
    if entry.get("pose") is not None:
        try:
            model = model.placed(entry["pose"])
        except (ValueError, TypeError, OverflowError) as error:
            raise StrategyError(f"{where}: {error}") from error
    return PlacedArray(model, entry.get("serial"))
