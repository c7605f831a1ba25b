"""Meshes of every kind that the kernels accept, small enough to be looked at face by face."""

import numpy as np

from palpate.datasets.shapes.built_in import shape

MIDDLE = np.array([0.0, 0.0, 0.2])


def placed(vertices, faces):
    return np.asarray(vertices, np.float32), np.asarray(faces, np.int64).reshape(-1, 3)


def merged(*meshes):
    """Several meshes as one, nothing welded."""
    vertices, faces, count = [], [], 0
    for one, two in meshes:
        vertices.append(one)
        faces.append(two + count)
        count += len(one)
    return placed(np.concatenate(vertices), np.concatenate(faces))


def moved(mesh, by=(0, 0, 0), scale=1.0):
    """Scaled about MIDDLE, then moved [m]."""
    return placed((mesh[0] - MIDDLE) * scale + MIDDLE + np.asarray(by), mesh[1])


def flipped(mesh):
    return mesh[0], mesh[1][:, ::-1]


def built_in(name):
    return placed(*shape(name))


def triangle():
    return placed(MIDDLE + np.array([[-0.03, -0.02, 0.01], [0.04, -0.01, -0.02], [0.0, 0.03, 0.02]]), [[0, 1, 2]])


def bowl():
    """The lower two thirds of a sphere: open, one rim."""
    vertices, faces = built_in("sphere")
    return vertices, faces[(vertices[faces][:, :, 2] < 0.22).all(axis=1)]


def torn():
    """A dog without every seventh face: many rims, vertices where rims touch."""
    vertices, faces = built_in("dog")
    return vertices, np.delete(faces, np.arange(0, len(faces), 7), axis=0)


def soup(count=60, seed=5):
    """Triangles that share nothing."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(count, 1, 3)) * 0.03 + rng.normal(size=(count, 3, 3)) * 0.02
    return placed(corners.reshape(-1, 3) + MIDDLE, np.arange(3 * count))


def fan():
    """Five triangles around one edge, some this way round, some that."""
    angle = np.arange(5) * 2 * np.pi / 5
    rim = np.stack([0.04 * np.cos(angle), 0.04 * np.sin(angle), 0.005 * angle], axis=1)
    vertices = MIDDLE + np.concatenate([[[0, 0, -0.03], [0.002, 0.001, 0.03]], rim])
    return placed(vertices, [[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 0, 5], [0, 1, 6]])


def unwelded_cubes():
    cube = moved(built_in("cube"), scale=0.4)
    return merged(moved(cube, (-0.026, -0.026, 0)), moved(cube, (0.026, 0.026, 0)))


def edge_sharing_cubes():
    """Two cubes that share an edge, with four triangles around it: closed, and no manifold."""
    vertices, faces = unwelded_cubes()
    welded, number = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
    assert len(welded) == len(vertices) - 2
    return placed(welded, number.reshape(-1)[faces])


def shell():
    """A rock with a cavity, and a cube in the cavity."""
    rock = built_in("boulder")
    return merged(rock, flipped(moved(rock, scale=0.7)), moved(built_in("cube"), scale=0.2))


def bodies():
    """Five bodies side by side; one has a hole, with another in it."""
    cube, tube = moved(built_in("cube"), scale=0.12), moved(built_in("tube"), scale=0.3)
    return merged(*(moved(cube, by) for by in ((0, 0, 0), (0.03, 0.03, 0), (-0.03, 0.03, 0), (0, -0.04, 0.01))), tube)


def slab(height, count, size=0.12):
    """A closed block with `count` x `count` vertices on top, at height(x, y) above MIDDLE [m], and a flat bottom."""
    x, y = (a.ravel() for a in np.meshgrid(*2 * [np.linspace(-size / 2, size / 2, count)], indexing="ij"))
    top = np.stack([x, y, height(x, y)], axis=1)
    k = np.arange(count * count).reshape(count, count)
    a, b, c, d = k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()
    rim = np.concatenate([k[:-1, 0], k[-1, :-1], k[:0:-1, -1], k[0, :0:-1]])
    foot = np.arange(len(rim)) + len(top)
    after, foot_after = np.roll(rim, -1), np.roll(foot, -1)
    middle = np.full(len(rim), len(top) + len(rim))
    faces = [[a, b, c], [a, c, d], [foot, foot_after, after], [foot, after, rim], [middle, foot_after, foot]]
    bottom = np.concatenate([top[rim], [[0, 0, 0]]]) * [1, 1, 0] + [0, 0, -0.05]
    return placed(np.concatenate([top, bottom]) + MIDDLE, np.concatenate([np.stack(f, axis=1) for f in faces]))


def egg_box():
    """Bumps side by side: a plane through them gives a loop each."""
    return slab(lambda x, y: 0.01 * np.cos(x * 2 * np.pi / 0.015) * np.cos(y * 2 * np.pi / 0.015) + 0.02 * x, 25)


def comb():
    """Ridges side by side, not along the axes: a plane through them enters a palm and leaves it again and again."""
    return slab(lambda x, y: 0.01 * np.sign(np.sin((x + 0.2 * y + 0.001) * 2 * np.pi / 0.011)), 25)


CLOSED = {
    "cube": lambda: built_in("cube"),
    "tube": lambda: built_in("tube"),
    "dog": lambda: built_in("dog"),
    "sphere": lambda: built_in("sphere"),
    "shell": shell,
    "bodies": bodies,
    "egg box": egg_box,
    "comb": comb,
}
OPEN_OR_ODD = {
    "triangle": triangle,
    "bowl": bowl,
    "torn dog": torn,
    "soup": soup,
    "fan": fan,
    "cubes sharing an edge": edge_sharing_cubes,
}
MESHES = CLOSED | OPEN_OR_ODD
GENUS = {"tube": 1, "bodies": 1}
BODIES = {"shell": 3, "bodies": 5}


def generic_poses(count, seed, spread=0.05):
    """Palms around MIDDLE, any way up, float32, shape [pose, 7]."""
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=(count, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.hstack([rng.uniform(-spread, spread, (count, 3)) + MIDDLE, quaternion]).astype(np.float32)
