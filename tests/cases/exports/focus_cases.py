"""Files of focal points as a sweep stores them."""

import numpy as np

from palpate.datasets.focus_files.frame_file import FrameField, FrameFile


def stored_focus(path, count=2000, foci=(), rate=4000.0, change=None):
    """Write focal points of intensity 0.5 at random positions, which are returned; foci: () or (n,).

    change: by name "position" or "intensity", a sample all of whose values are another.
    """
    values = {
        "position": np.random.default_rng(1).uniform(-0.05, 0.05, (count, *foci, 3)).astype(np.float32),
        "intensity": np.full((count, *foci), 0.5, np.float32),
    }
    for name, (sample, value) in (change or {}).items():
        values[name][sample] = value
    fields = [FrameField("/focus/position", (*foci, 3), "m"), FrameField("/focus/intensity", foci, "1")]
    about = {"format": "palpate focal points", "version": np.array([1, 0], np.int32), "recipe": "{}"}
    with FrameFile(path, fields, count, attributes={"/": about, "/focus": {"update_rate": rate}}) as file:
        file.append({f"/focus/{name}": rows for name, rows in values.items()})
        file.publish()
    return values["position"]
