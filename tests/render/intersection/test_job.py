"""A job is checked once, before anything is rendered: workers, memory, numbers of poses; names and files become it."""

import numpy as np
import pytest

from palpate.render import HandMotion, MeshObject, Palm, PoseError, Scene, StrategyError, render, static_pose
from palpate.render.intersection.batch_rendering import POINT_BYTES, collect
from palpate.render.intersection.job import MEMORY_SMALLEST, ContourJob, job_of, memory_for
from palpate.render.intersection.scene import SECTION_BYTES

TUBE = MeshObject.load("tube")
STILL = static_pose([0, 0, 0.2])


@pytest.fixture(scope="module")
def scene():
    return Scene.of(TUBE, Palm(), "cc")


def test_many_workers_have_more_memory_by_default():
    assert memory_for(["cpu"]) == 512 * 10**6
    assert memory_for(["cpu"] * 64) == 64 * 200 * 10**6
    assert memory_for(["cuda:0"] * 2) == 2 * 10**9
    assert POINT_BYTES < SECTION_BYTES


def test_a_job_has_one_worker_for_each_device_that_is_named(scene):
    assert ContourJob.of(scene, STILL).devices == ("cpu",)
    assert ContourJob.of(scene, STILL, devices="CPU").devices == ("cpu",)
    job = ContourJob.of(scene, STILL.pose, device="none", devices=["cpu"] * 3, memory=2.0**22)
    assert (job.devices, job.memory, job.motion.time) == (("cpu",) * 3, 2**22, None)


@pytest.mark.parametrize(
    ("means", "text"),
    [
        ({"device": "gpu"}, "no device 'gpu' on this machine; there is: cpu"),
        ({"devices": []}, "devices must name one device at least"),
        ({"memory": "much"}, "memory must be a number of bytes, not 'much'"),
        ({"memory": MEMORY_SMALLEST - 1}, "memory must be at least 1048576 bytes, not 1048575"),
        ({"memory": float("nan")}, "memory must be at least 1048576 bytes, not nan"),
        ({"memory": MEMORY_SMALLEST, "memory_least": 2**22}, "memory must be at least 4194304 bytes, not 1048576"),
    ],
    ids=lambda value: str(value),
)
def test_means_that_cannot_be_had_are_refused_with_value_and_bound(scene, means, text):
    with pytest.raises(StrategyError, match=text):
        ContourJob.of(scene, STILL, **means)


def test_an_object_with_another_number_of_poses_than_the_hand_is_refused():
    moving = Scene.of(TUBE, Palm(), "cc", object_pose=np.repeat(STILL.pose, 3, axis=0))
    with pytest.raises(PoseError, match="the object has 3 poses, the motion 1"):
        ContourJob.of(moving, STILL)


def test_the_job_of_names_renders_what_the_job_of_objects_renders(scene):
    motion = HandMotion([0.0, 0.1], np.repeat(STILL.pose, 2, axis=0))
    one, _ = collect(ContourJob.of(scene, motion))
    for made in (collect(job_of("tube", "palm", motion.pose, "cc"))[0], render("tube", "palm", motion, "cc")):
        for name, array in one.arrays().items():
            np.testing.assert_array_equal(array, made.arrays()[name], err_msg=name)


def test_progress_is_told_how_many_poses_are_done_and_how_many_there_are(scene):
    told = []
    motion = HandMotion(None, np.repeat(STILL.pose, 5, axis=0))
    collect(ContourJob.of(scene, motion, progress=lambda *counts: told.append(counts)))
    assert told[-1] == (5, 5)
    render(TUBE, Palm(), motion, progress=told.append)
    assert told[-1] == 5
