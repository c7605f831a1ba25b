"""Complex pressure by levitate and by AcousTools at the same points: values, and CPU seconds a pair.

    python benchmarks/pressure_peers.py levitate > levitate.json     # levitate 3.0.0, NumPy, scipy < 1.17
    python benchmarks/pressure_peers.py acoustools > acoustools.json  # acoustools 1.2.0, torch 2.13.0, vedo, matplotlib

It needs nothing of palpate, so that each runs in an environment of its own: their demands exclude each other's. Both
have the time factor exp(-j w t): their values are written as conjugates, which ours are. One thread. The array has
16 x 16 transducers 10.5 mm apart, in the plane z = 0, normals +z, each of 1 Pa at 1 m on its axis, focused at
(30, -20, 200) mm. The first SHOWN of 1000 points are written.
"""

import json
import os
import sys
from importlib.metadata import version
from time import process_time

os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")  # before NumPy loads
import numpy as np

CARRIER, SOUND_SPEED, RADIUS = 40e3, 343.0, 4.5e-3
FOCUS = (0.03, -0.02, 0.2)
POINTS, SHOWN, ROUNDS = 1000, 60, 7
PACKAGES = {"levitate": ("levitate", "numpy", "scipy"), "acoustools": ("acoustools", "torch", "numpy")}


def geometry() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Transducers [m], points [m], and drives for our time factor exp(+j w t)."""
    axis = (np.arange(16) - 7.5) * 10.5e-3
    y, x = np.meshgrid(axis, axis, indexing="ij")
    position = np.stack([x.ravel(), y.ravel(), np.zeros(256)], axis=1)
    points = np.random.default_rng(19).uniform([-0.1, -0.1, 0.02], [0.1, 0.1, 0.4], (POINTS, 3)).round(5)
    points[0] = FOCUS
    drive = np.exp(2j * np.pi * CARRIER / SOUND_SPEED * np.linalg.norm(position - FOCUS, axis=1))
    return position, points, drive


def levitate(position: np.ndarray, points: np.ndarray, drive: np.ndarray):
    vars(np)["complex"] = complex  # levitate asks for what NumPy 1.24 removed
    import levitate as peer

    peer.materials.air.c = SOUND_SPEED
    transducer = peer.transducers.CircularPiston(effective_radius=RADIUS, freq=CARRIER, p0=1.0)
    array = peer.arrays.TransducerArray(position.T, np.tile([[0.0], [0.0], [1.0]], 256), transducer=transducer)
    field = peer.fields.Pressure(array)
    return lambda: np.conj((field @ points.T)(np.conj(drive)))  # the waves are made when points are bound


def acoustools(position: np.ndarray, points: np.ndarray, drive: np.ndarray):
    import torch
    from acoustools import Utilities

    torch.set_num_threads(1)
    board = torch.tensor(position, dtype=torch.float32)
    normals = torch.tensor(np.tile([0, 0, 1.0], (256, 1)), dtype=torch.complex64)
    columns = torch.tensor(points.T[None], dtype=torch.float32)
    activation = torch.tensor(np.conj(drive)[None, :, None], dtype=torch.complex64)
    k = 2 * np.pi * CARRIER / SOUND_SPEED

    def run() -> np.ndarray:
        out = Utilities.propagate(
            activation, columns, board=board, p_ref=1.0, norms=normals, k=k, transducer_radius=RADIUS
        )
        return np.conj(out.numpy().ravel())

    return run


def main() -> None:
    name = sys.argv[1]
    position, points, drive = geometry()
    run = {"levitate": levitate, "acoustools": acoustools}[name](position, points, drive)
    value = run()
    taken = []
    for _ in range(ROUNDS):
        started = process_time()
        run()
        taken.append(process_time() - started)
    seconds = float(np.median(taken))
    shown = np.column_stack([points, value.real, value.imag])[:SHOWN]
    result = {
        "by": {each: version(each) for each in PACKAGES[name]},
        "nanoseconds_a_pair": round(seconds / POINTS / 256 * 1e9, 1),
        "columns": ["x [m]", "y [m]", "z [m]", "real", "imaginary"],
        "rows": [[float(f"{v:.9g}") for v in row] for row in shown],
    }
    print(json.dumps(result).replace("], [", "],\n["))


if __name__ == "__main__":
    main()
