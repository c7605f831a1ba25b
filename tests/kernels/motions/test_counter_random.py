"""Counted random numbers on a device: those of NumPy's Philox, bit for bit."""

import numpy as np
import warp as wp

from palpate.datasets.motions import counter_random as model
from palpate.kernels.motions.counter_random import bell, uniform, vec2ul
from palpate.kernels.patch import EXACT

wp.set_module_options(EXACT)


@wp.kernel
def _draw(
    # In:
    keys: wp.array[vec2ul],
    counter: wp.array2d[wp.int64],
    # Out:
    four: wp.array[wp.vec4d],
    one: wp.array[wp.float64],
):
    """Four uniform numbers and one bell-shaped."""
    i = wp.tid()
    second = int(counter[i, 1])
    third = int(counter[i, 2])
    four[i] = uniform(keys[i], counter[i, 0], second, third, int(counter[i, 3]))
    one[i] = bell(keys[i], counter[i, 0], second, third)


def test_every_bit_is_that_of_numpys_philox(device, rng):
    """NumPy adds 1 to the first word before it makes a block."""
    count = 150
    keys = rng.integers(0, 2**64, (count, 2), dtype=np.uint64)
    counter = np.column_stack([rng.integers(1, 2**62, count), rng.integers(0, 2**31, (count, 3))])
    four, one = wp.zeros(count, wp.vec4d, device=device), wp.zeros(count, wp.float64, device=device)
    inputs = [wp.array(keys, dtype=vec2ul, device=device), wp.array(counter, dtype=wp.int64, device=device)]
    wp.launch(_draw, count, inputs=inputs, outputs=[four, one], device=device)
    for k in range(count):
        start = counter[k].astype(np.uint64) - np.array([1, 0, 0, 0], np.uint64)
        words = np.random.Philox(key=keys[k], counter=start).random_raw(4)
        np.testing.assert_array_equal(four.numpy()[k], (words >> np.uint64(11)) * 2.0**-53)
        key = (int(keys[k, 0]), int(keys[k, 1]))
        assert one.numpy()[k] == model.bell(key, *counter[k, :3].tolist())
