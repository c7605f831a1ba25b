"""The poses that throughput is measured on: independent palms, uniform in the objects' cube and in orientation."""

from palpate.render.bench.cases import random_poses

__all__ = ["random_poses"]
