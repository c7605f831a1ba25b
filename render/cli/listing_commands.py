"""`palpate sampling` and `palpate devices`: what there is to choose from; neither needs Warp."""

import json
from dataclasses import asdict
from pathlib import Path

from ...device.boards.discovery import find_arrays, find_serial_arrays, udev_rule
from ...device.errors import NoBackendError
from ...device.registry import array_kinds, array_model, array_names
from ..sampling.presets import LINES, PRESETS, load_sampling
from ..terminal import console
from ..terminal.foreign_text import print_message, write_output


def run_sampling(name: str | None, *, as_json: bool) -> None:
    """Show presets, or one strategy as the JSON that --sampling takes."""
    if name is None:
        values = {"presets": list(PRESETS), "lines": LINES} if as_json else LINES
        console.show_values(values, as_json=as_json, title="sampling presets")
        return
    write_output(json.dumps(load_sampling(name).described(), indent=None if as_json else 1) + "\n")


def run_devices(calibrations: list[Path] | None, *, as_json: bool) -> None:
    """List arrays: what is emulated, what libusb sees, and what cannot be seen."""
    found: list[dict] = [
        {"array": kind.name, "serial": None, "where": "emulated", "accessible": True, "certain": True, "reason": None}
        for kind in array_kinds()
        if kind.is_emulated
    ]
    emulated_count = len(found)
    notes: list[str] = []
    for find in (lambda: find_arrays(calibrations=calibrations or ()), find_serial_arrays):
        try:
            found += [asdict(entry) for entry in find()]
        except NoBackendError as error:
            notes.append(str(error))
    if as_json:
        rules = {name: udev_rule(array_model(name)) for name in array_names()}
        console.show_values(
            {"devices": found, "note": "; ".join(notes) or None, "udev_rules": rules}, as_json=True, title=""
        )
        return
    rows = {}
    for entry in found:
        where = entry["where"] + ("" if entry["accessible"] else ", cannot be opened")
        name = f"{entry['array']} {entry['serial'] or ''}".strip() + ("" if entry["certain"] else "?")
        name = f"{name} at {entry['where']}" if name in rows else name  # adapters without a serial number
        rows[name] = f"{where}: {entry['reason']}" if entry["reason"] else where
    console.show_values(rows, as_json=False, title="arrays")
    if not notes and len(found) == emulated_count:
        notes.append("nothing on USB has the ids of an array's chip, and there is no serial adapter")
    notes += [kind.not_listed for kind in array_kinds() if kind.not_listed]
    print_message(console.worded("; ".join(notes)), "note")
