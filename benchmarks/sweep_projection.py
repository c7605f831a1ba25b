"""How sweeps scale, measured, and on paper beyond: a picture and a table from lines of `sweeps.py devices`.

    python benchmarks/sweeps.py devices --devices cpu cpu > cpu.jsonl
    python benchmarks/sweeps.py devices --devices cuda:0 cuda:1 --poses 4000000000 > cuda.jsonl
    python benchmarks/sweeps.py parent                                   # seconds of the parent a chunk
    python benchmarks/sweep_projection.py cpu.jsonl cuda.jsonl --parent 1e-4 --picture scaling.png

docs/pictures.py draws docs/measured/sweep-scaling.json in the same way.

On paper a sweep of N poses on n devices takes start + max(N / (n rate), chunks x parent): workers share nothing but the
parent, which records every chunk, one after the other, while they go on. `rate` is one device's, measured;
what n of them lose to each other (a host's memory, its disk) is not in it, but for the measured points.
"""

import argparse
import json
from pathlib import Path

from matplotlib.figure import Figure

from palpate.render.sweeps.make.unit import CHUNK_POSES

DEVICES = (1, 2, 4, 8, 16, 32, 64, 128, 256)


def projected_seconds(poses: float, devices: int, *, rate: float, parent: float, start: float) -> float:
    """Seconds of a sweep on paper; rate of one device [pose/s], parent [s] a chunk, start [s]."""
    return start + max(poses / (devices * rate), -(-poses // CHUNK_POSES) * parent)


def table(poses: float, lines: list[dict], parent: float) -> list[dict]:
    """On paper, for each number of devices, from the line of one device."""
    one = lines[0]
    rows = []
    for devices in DEVICES:
        seconds = projected_seconds(
            poses, devices, rate=one["poses_per_second"], parent=parent, start=one["start_seconds"]
        )
        rows.append({"devices": devices, "poses": poses, "seconds": seconds, "poses_per_second": poses / seconds})
    return rows


def projection_figure(measured: dict[str, list[dict]], poses: float, parent: float) -> Figure:
    """Poses a second against devices: measured points, lines on paper."""
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.add_subplot()
    looks = zip(("#2d2a45", "#c1121f", "#1f6fa8"), "os^", ("-", "--", ":"), strict=True)
    for (color, marker, dash), (name, lines) in zip(looks, measured.items(), strict=False):
        rows = table(poses, lines, parent)
        rates = [row["poses_per_second"] for row in rows]
        axes.plot(DEVICES, rates, color=color, ls=dash, label=f"{name}, on paper")
        rates = [line["poses_per_second"] for line in lines]
        axes.plot([line["devices"] for line in lines], rates, marker, color=color, label=f"{name}, measured")
    limit = CHUNK_POSES / parent
    axes.axhline(limit, color="0.6", linewidth=0.8, linestyle=(0, (1, 1)), label="most that one parent can record")
    axes.set(xscale="log", yscale="log", xlabel="devices", ylabel="poses a second", title="tube, CC, metrics only")
    axes.set_xticks(DEVICES, [str(n) for n in DEVICES])
    axes.minorticks_off()
    axes.grid(color="0.9")
    axes.legend(frameon=False, fontsize=8)
    return figure


def draw(measured: dict[str, list[dict]], poses: float, parent: float, picture: Path) -> None:
    """Draw `projection_figure` into a picture."""
    projection_figure(measured, poses, parent).savefig(picture, dpi=140)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("lines", nargs="+", type=Path, help="files of JSON lines, one a kind of device")
    parser.add_argument("--parent", type=float, required=True, help="seconds of the parent a chunk")
    parser.add_argument("--poses", type=float, default=1e12)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    measured = {path.stem: [json.loads(line) for line in path.read_text().splitlines()] for path in options.lines}
    for name, lines in measured.items():
        for row in table(options.poses, lines, options.parent):
            print(json.dumps({"device": name, **row}))
    if options.picture:
        draw(measured, options.poses, options.parent, options.picture)


if __name__ == "__main__":
    main()
