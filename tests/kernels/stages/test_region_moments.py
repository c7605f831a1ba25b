"""Sums of lines on a device have the bits of the oracle's; those of a region are of its polylines, in their order."""

import numpy as np
from regions_oracle import FlatLines
from transform_cases import region_batches

from palpate.kernels.stages.region_moments import sum_moments
from palpate.render.stages.patch_regions import regions_of


def test_lengths_and_moments_of_lines_have_the_bits_of_the_oracle(device, rng):
    for batch, setting in region_batches(rng, device):
        flat, regions = FlatLines(batch, setting), regions_of(batch.to(device), setting, "region")
        sums = sum_moments(regions)
        stroke = sums.stroke.numpy().reshape(-1, 7)
        np.testing.assert_array_equal(stroke[:, :6], flat.strokes)
        np.testing.assert_array_equal(stroke[:, 6], flat.heights)
        assert sums.area.ptr == regions.area.ptr
