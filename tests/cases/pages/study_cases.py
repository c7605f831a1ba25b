"""A study's pages without a study: a cube, a moment of a live run, screens of each kind, and a socket that asks."""

import contextlib
import json
import math
import time
from contextlib import contextmanager

import numpy as np
from page_oracle import decoded
from websockets.sync.client import connect

from palpate.render.hands.hand import Palm
from palpate.render.live.counts import Durations
from palpate.render.live.moment import LiveMoment, LiveScene
from palpate.render.sampling.strategy import SamplingStrategy
from palpate.render.study.pages.experimenter_page import study_server
from palpate.render.study.plan.study_plan import Question
from palpate.render.study.run.desk import KeyChoice, ShownObject, StudyDesk
from palpate.render.view.served.page_server import HOST

POSE = np.array([0, 0, 0.2, 0, 0, 0, 1], np.float32)
SPACE = (KeyChoice(key=" ", label="Weiter"),)
ARROWS = (KeyChoice(key="ArrowRight", label="Second", value=1), KeyChoice(key="ArrowLeft", label="First", value=0))
SCALE = Question(
    name="confidence", text="How sure are you?", kind="scale", low_text="not at all", high_text="completely"
)
SCALE_KEYS = tuple(KeyChoice(key=str(i), label=str(i), value=i) for i in range(1, 8))
CHOICE = Question(name="denser", text="Which one felt denser?", kind="choice", options=("First", "Second"))
AGE = Question(name="age", text="How old are you?", kind="number", low=18, high=99)
WORDS = Question(name="words", text="How did they differ?", kind="text")


def cube_mesh(shown=None):
    """A cube of 8 cm around a point 20 cm above the array."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [tri for a, b, c, d in faces for tri in ((a, b, c), (a, c, d))]
    return (0.04 * corners + [0, 0, 0.2]).astype(np.float32), np.array(triangles, np.int32)


def scene_around(hand_mesh):
    """A live scene whose hand is a mesh in the hand's frame: vertices and faces."""
    vertices, faces = cube_mesh()
    return LiveScene(
        object_name="secret object", vertices=vertices, faces=faces, strategy={"raw": "section"},
        sampling=SamplingStrategy(), hand=Palm(0.085, 0.085), hand_vertices=hand_mesh[0], hand_faces=hand_mesh[1],
        glabrous=np.zeros(len(hand_mesh[1]), bool), is_skin=False,
    )  # fmt: skip


def square_hand(width=0.06):
    """A square as a hand: what its place and its colour are is plain in pixels."""
    half = width / 2
    corners = [[-half, 0, -half], [half, 0, -half], [half, 0, half], [-half, 0, half]]
    return np.array(corners, np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def moment_at(scene, pose=POSE, number=1, **values):
    """A moment of a live run with the hand at a pose."""
    counts = {"latency": Durations(0.004, 0.007, math.nan), "poses": 1, "frames": 40_000, "dropped": 3}
    return LiveMoment(
        number=number, scene=scene, hand_pose=pose, **{"state": "tracking", "time": 1.5, **counts} | values
    )


def show_object(opacity=1.0, *, has_hand=True, solid="cube"):
    """Fields of a screen with an object."""
    return {"shown": ShownObject(solid=solid, opacity=opacity, has_hand=has_hand)}


@contextmanager
def served_study(desk=None, **options):
    """A desk and the server of its pages."""
    desk = desk or StudyDesk()
    server = study_server(desk, options.pop("mesh", cube_mesh), **options)
    try:
        yield desk, server
    finally:
        server.close()


def visit(server, path="/"):
    """A connection as the page makes it."""
    query = server.address().split("?")[1]
    return connect(f"ws://{HOST}:{server.port}{path}?{query}", open_timeout=10, compression=None)


def ask(connection, **request):
    """The answer to a request."""
    return raw_answer(connection, json.dumps(request))[0]


def raw_answer(connection, message):
    """The answer to any message: as the page reads it, and its bytes."""
    connection.send(message)
    answer = connection.recv(timeout=10)
    size = int.from_bytes(answer[:4], "little")
    return decoded(json.loads(answer[4 : 4 + size]), answer[4 + size :]), answer


def wait_until(condition, seconds=5.0):
    """Wait until something is true; whether it is."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    with contextlib.suppress(AssertionError):
        return bool(condition())
    return False
