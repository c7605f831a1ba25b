"""Old names of public attributes and keywords work, with a DeprecationWarning that points at the caller."""

import numpy as np
import pytest

from palpate.render import MeshObject, Palm, Scene, open_contour, record, render, simplify, voxelise
from palpate.render.deprecated_names import accept_old_keywords
from palpate.render.stages.registry import Setting

POSE = np.array([[0, 0, 0.2, 0, 0, 0, 1]], np.float32)


def test_a_stage_can_read_the_old_names_of_its_setting():
    solid, centre = MeshObject.load("tube"), np.zeros(3)
    setting = Setting(solid, Palm(), POSE, 0, "cpu", 0.01, 0.0025, object_pose=POSE, object_centre=centre)
    for old, new in (("thing", solid), ("moved", POSE), ("pivot", centre)):
        with pytest.warns(DeprecationWarning, match=old) as caught:
            assert getattr(setting, old) is new
        assert caught[0].filename == __file__


def test_scene_and_render_take_the_old_keywords():
    solid, strategy = MeshObject.load("tube"), open_contour()
    with pytest.warns(DeprecationWarning, match="'moved' is now called 'object_pose'") as caught:
        old = render(solid, Palm(), POSE, strategy, moved=POSE)
    assert caught[0].filename == __file__
    np.testing.assert_array_equal(old.points, render(solid, Palm(), POSE, strategy, object_pose=POSE).points)
    with pytest.warns(DeprecationWarning, match="'thing'"):
        scene = Scene.of(thing=solid, hand=Palm(), strategy=strategy)
    with pytest.warns(DeprecationWarning, match="'thing'"):
        assert scene.thing is scene.solid
    for function in (record, simplify, voxelise):
        with pytest.warns(DeprecationWarning, match="'thing'"), pytest.raises(TypeError):
            function(thing=solid, unknown=None)


def test_an_argument_under_both_names_is_refused():
    @accept_old_keywords(old="new")
    def function(new):
        return new

    assert function(1) == function(new=1) == 1
    with pytest.raises(TypeError, match="both 'new' and its old name 'old'"):
        function(new=1, old=1)
