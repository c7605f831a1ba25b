"""The sampler in NumPy, pose after pose: slow, by other means than the kernels, to compare them with."""
