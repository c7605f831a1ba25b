"""Which parts of contours run too close beside others, in plain loops."""

import numpy as np


class SlowThinning:
    """The rule of `kernels.prune_close` for one pose whose polylines do not touch, in plain loops."""

    def __init__(self, batch, pose, longest, *, distance, angle, apart, across):
        self.distance, self.cosine, self.apart, self.across = distance, np.cos(angle), apart, across
        self.parts, self.order = {}, []
        for line in range(batch.pose_start[pose], batch.pose_start[pose + 1]):
            points = batch.points[batch.polyline_start[line] : batch.polyline_start[line + 1]].astype(float)
            way = np.diff(points, axis=0)
            lengths = np.linalg.norm(way, axis=1)
            own, passed = [], 0.0
            for a, d, length in zip(points, way, lengths, strict=False):
                count = max(int(np.ceil(length / longest)), 1)
                own += [
                    ((k + 0.5) / count * d + a, d / count, passed + (k + 0.5) / count * length) for k in range(count)
                ]
                passed += length
            self.parts[line] = own
            self.order.append((-passed, line))
        self.closed, self.patch = batch.polyline_closed, batch.polyline_patch
        self.keep = {line: [True] * len(own) for line, own in self.parts.items()}
        self.order.sort()

    def run(self):
        changed = True
        while changed:
            changed = False
            for rank, (_, line) in enumerate(self.order):
                for k in range(len(self.parts[line])):
                    if self.keep[line][k] and self.crowded(rank, line, k):
                        self.keep[line][k], changed = False, True
        return [kept for line in sorted(self.keep) for kept in self.keep[line]]

    def crowded(self, rank, line, k):
        for _, other in self.order[: rank + 1]:
            if not self.across and self.patch[other] != self.patch[line]:
                continue
            for j in range(k if other == line else len(self.parts[other])):
                beside = self.keep[other][j] and self.beside(self.parts[line][k], self.parts[other][j])
                if beside and not (other == line and self.joined(line, j, k)):
                    return True
        return False

    def joined(self, line, j, k):
        kept = self.keep[line]
        gap = self.parts[line][k][2] - self.parts[line][j][2]
        if gap <= self.apart and all(kept[j:k]):
            return True
        total = -next(length for length, own in self.order if own == line)
        return bool(self.closed[line]) and total - gap <= self.apart and all(kept[:j]) and all(kept[k:])

    def beside(self, one, other):
        (p, a, _), (q, b, _) = one, other
        if abs(a @ b) < self.cosine * np.linalg.norm(a) * np.linalg.norm(b):
            return False
        return any(self.near(p + t * a, a, q, b) or self.near(q + t * b, b, p, a) for t in (-0.5, 0, 0.5))

    def near(self, x, a, middle, b):
        d = x - middle - np.clip((x - middle) @ b / (b @ b), -0.5, 0.5) * b
        gap = np.linalg.norm(d)
        square = np.sqrt(0.5) * gap
        return (
            gap < self.distance
            and abs(d @ a) <= square * np.linalg.norm(a)
            and abs(d @ b) <= square * np.linalg.norm(b)
        )
