"""Directions to look from: known axes on the picture, lengths that can be measured, and refusals."""

import numpy as np
import pytest

from palpate.datasets import static_pose
from palpate.render import Palm
from palpate.render.errors import StrategyError
from palpate.render.reports.scene_view import NAMED, SceneView, flat

AXES = np.eye(3)


@pytest.mark.parametrize(
    ("view", "right", "up"),
    [("top", AXES[0], AXES[1]), ("front", AXES[0], AXES[2]), ("side", AXES[1], AXES[2]), ("back", -AXES[0], AXES[2])],
)
def test_named_views_show_the_axes_where_engineers_expect_them(view, right, up):
    np.testing.assert_allclose(SceneView.of(view).basis()[:2], [right, up], atol=1e-12)


@pytest.mark.parametrize("view", [*NAMED, "12.5,200", (-90, 0), [5, 5]])
def test_every_view_is_a_rotation_so_lengths_in_its_plane_are_true(view):
    basis = SceneView.of(view).basis()
    np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(basis) == pytest.approx(1.0)
    assert flat(0.05 * basis[0], basis) == pytest.approx([50.0, 0.0])


def test_the_palms_own_view_shows_its_rectangle_upright_and_in_true_size():
    rng = np.random.default_rng(3)
    for q in rng.normal(size=(5, 4)):
        pose = np.array([*rng.normal(size=3), *(q / np.linalg.norm(q))], np.float32)
        corners = flat(Palm(0.08, 0.1).corners(pose[None])[0, 0], SceneView.of("palm").basis(pose))
        np.testing.assert_allclose(np.ptp(corners, axis=0), [80.0, 100.0], rtol=1e-5)
        fingers = static_pose([0, 0, 0]).pose[0]
        assert fingers.shape == (7,)


@pytest.mark.parametrize(
    ("view", "message"),
    [
        ("isoo", "did you mean 'iso'"),
        ("91,0", "between -90 and 90 degrees, not 91"),
        ("nan,0", "between -90 and 90"),
        ("1,2,3", "ELEVATION,AZIMUTH"),
        ((1,), "unknown view"),
        (7, "unknown view 7"),
        ("", "unknown view ''"),
    ],
)
def test_unknown_views_are_refused_with_those_that_there_are(view, message):
    with pytest.raises(StrategyError, match=message):
        SceneView.of(view)
