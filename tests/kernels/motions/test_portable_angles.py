"""Functions of angles on a device: the bits of those in NumPy, which have tests of their own."""

import numpy as np
import warp as wp

from palpate.datasets.motions import portable_angles as model
from palpate.kernels.motions.portable_angles import arc_tangent, hyperbolic_tangent, sine_cosine, sine_of_turns
from palpate.kernels.patch import EXACT

wp.set_module_options(EXACT)


@wp.kernel
def _ask(
    # In:
    angle: wp.array[wp.float64],
    across: wp.array[wp.float64],
    # Out:
    value: wp.array2d[wp.float64],
):
    """Every function."""
    i = wp.tid()
    pair = sine_cosine(angle[i])
    value[i, 0] = pair[0]
    value[i, 1] = pair[1]
    value[i, 2] = sine_of_turns(angle[i])
    value[i, 3] = arc_tangent(across[i], angle[i])
    value[i, 4] = hyperbolic_tangent(across[i])


def test_every_bit_is_that_of_the_model(device, rng):
    spans = np.repeat([1e-9, 1e-3, 1.0, 20.0, 3000.0], 8_000)
    angle = np.append(spans * rng.uniform(-1, 1, len(spans)), [0.0, -0.0, np.pi / 4, -np.pi / 2, np.pi, 2.5])
    across = np.append(rng.uniform(0, 20, len(spans)), [0.0, 0.0, np.pi / 4, 1.0, 0.0, 2.5])
    value = wp.zeros((len(angle), 5), dtype=wp.float64, device=device)
    inputs = [wp.array(column, dtype=wp.float64, device=device) for column in (angle, across)]
    wp.launch(_ask, len(angle), inputs=inputs, outputs=[value], device=device)
    wanted = [*model.sine_cosine(angle), model.sine_of_turns(angle)]
    wanted += [model.arc_tangent(across, angle), model.hyperbolic_tangent(across)]
    np.testing.assert_array_equal(value.numpy(), np.stack(wanted, axis=1))
