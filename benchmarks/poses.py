"""The poses that throughput is measured on: independent palms, uniform in the objects' cube and in orientation."""

import numpy as np


def random_poses(count: int, seed: int = 0) -> np.ndarray:
    """Centres uniform in the 130 mm cube at (0, 0, 0.2) m, orientations uniform on SO(3); float32, shape [pose, 7]."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-0.065, 0.065, size=(count, 3)) + np.array([0.0, 0.0, 0.2])
    turn = rng.normal(size=(count, 4))
    return np.concatenate([centre, turn / np.linalg.norm(turn, axis=1, keepdims=True)], axis=1).astype(np.float32)
