"""`palpate info MESH`: planted faults are counted as they were planted, and the ways out that it names work."""

import numpy as np
import pytest
import trimesh
from box_meshes import box, inverted, joined
from command_line import answer, run

from palpate.datasets import ContourFile
from palpate.render import MeshObject, Palm, closed_contour, open_contour, render
from palpate.render.errors import MeshError, PalpateWarning
from palpate.render.objects.mesh import repair as mend

LEVEL = np.array([[0, 0, 0.2, -np.sqrt(0.5), 0, 0, np.sqrt(0.5)]])  # a palm parallel to the array


def without_top(body):
    """A box less the two triangles of its top: a hole whose rim is four sides long."""
    vertices, faces = body
    top = vertices[:, 2] == vertices[:, 2].max()
    return vertices, faces[~top[faces].all(axis=1)]


CUBE = box(0.08, (0.0, 0.0, 0.2))
FLAG = (np.array([[0.06, -0.02, 0.15], [0.06, 0.02, 0.15], [0.06, 0.02, 0.25], [0.06, -0.02, 0.25]]),
        np.array([[0, 1, 2], [0, 2, 3]]))  # fmt: skip
SPHERE = trimesh.creation.icosphere(subdivisions=2, radius=0.03)
BALL = np.asarray(SPHERE.vertices) + np.array([0.0, 0.0, 0.2])
TORN = np.delete(np.asarray(SPHERE.faces), SPHERE.triangles_center.argmax(axis=0), axis=0)  # 3 holes of 3 edges each


FAULTS = {
    "nothing": (CUBE, {"bodies": 1, "triangles": 12}),
    "repeats": ((CUBE[0], CUBE[1][[*range(12), 3, 7]]), {"faces_dropped": 2}),
    "corner twice": ((CUBE[0], np.vstack([CUBE[1], [[0, 0, 1], [2, 3, 2]]])), {"faces_dropped": 2}),
    "turned triangles": ((CUBE[0], np.where(np.isin(np.arange(12), [2, 9])[:, None], CUBE[1][:, ::-1], CUBE[1])),
                         {"faces_turned": 2}),
    "inside out": (inverted(CUBE), {"bodies_turned": 1}),
    "cavity": (joined(CUBE, inverted(box(0.04, (0, 0, 0.2)))), {"bodies": 2, "cavities": 1, "bodies_turned": 0}),
    "hidden": (joined(CUBE, box(0.04, (0, 0, 0.2))), {"bodies": 2, "bodies_hidden": 1}),
    "united": (joined(CUBE, box(0.08, (0.03, 0.02, 0.21))), {"bodies": 2, "bodies_united": 2, "crossings": 0}),
    "open box": (without_top(CUBE), {"open_edges": 4, "holes": 1, "closed_contours": "refused"}),
    "torn sphere": ((BALL, TORN), {"open_edges": 9, "holes": 3}),
    "flag": (joined(CUBE, FLAG), {"open_edges": 4, "holes": 1, "sheet_faces": 2, "closed_contours": "exact"}),
    "flag with a back": (joined(CUBE, FLAG, inverted(FLAG)), {"open_edges": 0, "faces_dropped": 4}),
    "flag with another back": (joined(CUBE, FLAG, (FLAG[0], np.array([[3, 1, 0], [3, 2, 1]]))), {"bodies_flat": 1}),
}  # fmt: skip


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("suffix", ["ply", "stl"])
@pytest.mark.parametrize("name", FAULTS)
def test_planted_faults_are_counted(name, suffix, tmp_path):
    (vertices, faces), planted = FAULTS[name]
    path = tmp_path / f"mesh.{suffix}"
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    told = answer("info", path)
    assert {key: str(told[key]).split(":")[0] for key in planted} == {key: str(value) for key, value in planted.items()}
    assert (told["changed"], told["left"]) == ("nothing", "nothing") or name != "nothing"
    assert {told["changed"], told["left"]} != {"nothing"} or name in ("nothing", "cavity")


def suggested(told, option):
    """The value that the table suggests for an option."""
    words = told["could_be_done"].split()
    return words[words.index(option) + 1]


def test_a_t_junction_is_refused_by_the_length_of_rim_that_closes_it():
    """A cube of 100 mm, given in millimetres, one of whose edges has a vertex in the middle for one triangle only."""
    vertices, faces = box(100.0, (0, 0, 200))
    a, b, c = faces[0]
    middle = 0.5 * (vertices[a] + vertices[b])
    split = np.vstack([faces[1:], [[a, len(vertices), c], [len(vertices), b, c]]])
    arrays = np.vstack([vertices, middle]), split
    rim = 2 * np.linalg.norm(vertices[a] - vertices[b]) / 1000
    with pytest.warns(PalpateWarning, match="3 open edges"):
        cracked = MeshObject(*arrays, scale=0.001)
    with pytest.raises(MeshError, match="fill_holes=") as refusal:
        cracked.require_closed()
    length = float(str(refusal.value).partition("fill_holes=")[2].split()[0])
    assert rim <= length <= 1.1 * rim
    with pytest.warns(PalpateWarning, match="1 holes filled"):
        whole = MeshObject(*arrays, scale=0.001, fill_holes=length)
    assert render(whole, Palm(), LEVEL, closed_contour()).length() == pytest.approx([4 * 0.085], abs=1e-6)  # all inside


def test_filling_holes_as_suggested_closes_them_and_a_shorter_length_none(tmp_path):
    (vertices, faces), _ = FAULTS["torn sphere"]
    path = tmp_path / "torn.ply"
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    corners = SPHERE.triangles[SPHERE.triangles_center.argmax(axis=0)]  # of the triangles that are missing
    rims = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).sum(axis=1)
    assert answer("info", path, "--fill-holes", 0.999 * rims.min())["holes_filled"] == 0
    length = suggested(answer("info", path), "--fill-holes")
    told = answer("info", path, "--fill-holes", length)
    assert (told["open_edges"], told["holes_filled"], told["closed_contours"]) == (0, 3, "exact")
    with pytest.warns(PalpateWarning, match="3 holes filled"):
        filled = MeshObject.load(path, fill_holes=float(length))
    volume = trimesh.Trimesh(filled.vertices.astype(np.float64), filled.faces).volume
    assert volume == pytest.approx(SPHERE.volume, rel=1e-5)  # a lid over one triangle is that triangle


def test_welding_as_suggested_closes_a_soup_whose_corners_are_apart(tmp_path, rng):
    vertices, faces = CUBE
    soup = vertices[faces].reshape(-1, 3) + rng.uniform(-4e-7, 4e-7, (36, 3))
    path = tmp_path / "soup.ply"
    trimesh.Trimesh(soup, np.arange(36).reshape(-1, 3), process=False).export(path)
    told = answer("info", path)
    assert (told["open_edges"], told["bodies"]) == (36, 12)
    told = answer("info", path, "--weld", suggested(told, "--weld"))
    assert (told["open_edges"], told["bodies"], told["vertices_kept"]) == (0, 1, 8)


def test_sheets_beside_a_solid_are_drawn_by_oc_and_left_out_of_cc(device):
    with pytest.warns(PalpateWarning, match="2 triangles of open surfaces enclose nothing: OC draws them, CC leaves"):
        thing = MeshObject(*joined(CUBE, FLAG))
    lengths = [render(thing, Palm(0.4, 0.4), LEVEL, s(), device=device).length()[0] for s in
               (open_contour, closed_contour)]  # fmt: skip
    assert lengths == pytest.approx([4 * 0.08 + 0.04, 4 * 0.08], abs=1e-6)


def test_rule_of_inside_is_stored_and_tells_objects_apart(tmp_path):
    one, other = (MeshObject(*CUBE, solid=solid) for solid in ("winding", "even-odd"))
    assert one.identity != other.identity
    out = tmp_path / "cube.h5"
    assert run("render", "cube", "exploration", "-o", out, "--solid", "even-odd", "--duration", "0.1").exit_code == 0
    with ContourFile(out) as file:
        assert file.object()["attributes"]["repair"] == {"solid": "even-odd", "weld": 0.0, "fill_holes": 0.0}


def test_sheets_beside_bodies_that_cross_are_drawn_with_what_the_bodies_bound(device):
    """Two overlapping boxes under the even-odd rule stay two: their section and a flag's are drawn together."""
    bodies = joined(CUBE, box(0.08, (0.03, 0.02, 0.21)))
    with pytest.warns(PalpateWarning, match="sections are regularised.*OC draws them"):
        thing = MeshObject(*joined(bodies, (FLAG[0] + [0.1, 0, 0], FLAG[1])), solid="even-odd")
    assert not thing.is_simple
    pose = np.concatenate([LEVEL, LEVEL])
    pose[1, 0] += 0.005
    oc, cc = (render(thing, Palm(0.5, 0.5), pose, s(), device=device) for s in (open_contour, closed_contour))
    assert cc.length() == pytest.approx([2 * 4 * 0.08] * 2, abs=1e-6)  # what both hold is a hole between two corners
    assert oc.length() == pytest.approx([2 * 4 * 0.08 + 0.04] * 2, abs=1e-6)
    assert [len(oc.polylines_of(k)) for k in range(2)] == [len(cc.polylines_of(k)) + 1 for k in range(2)]


def test_a_file_in_millimetres_is_told_the_scale(tmp_path):
    path = tmp_path / "cube.stl"
    trimesh.creation.box([40.0] * 3).export(path)
    assert "--scale 0.001 " in answer("info", path)["could_be_done"]
    told = answer("info", path, "--scale", "0.001")
    assert told["could_be_done"] == "nothing needed"
    assert told["size"] == pytest.approx([0.04] * 3)


def test_lids_are_not_suggested_where_they_enclose_nothing(tmp_path, rng):
    """Triangles that are apart are holes each: a lid would be their back."""
    loose = BALL[SPHERE.faces].reshape(-1, 3) + rng.uniform(-2e-5, 2e-5, (3 * len(SPHERE.faces), 3))
    path = tmp_path / "loose.ply"
    trimesh.Trimesh(loose, np.arange(len(loose)).reshape(-1, 3), process=False).export(path)
    told = answer("info", path)
    assert "--fill-holes" not in told["could_be_done"]
    closed = answer("info", path, "--weld", suggested(told, "--weld"))
    assert (closed["open_edges"], closed["closed_contours"]) == (0, "exact")


def test_other_warnings_of_loading_are_in_the_table(tmp_path):
    path = tmp_path / "cube.ply"
    trimesh.Trimesh(CUBE[0] - [0, 0, 0.4], CUBE[1], process=False).export(path)
    assert "reaches behind the array" in answer("info", path)["warned"]


def test_a_union_that_lost_a_body_is_not_believed(monkeypatch, device):
    """Fault injected: the smaller of two boxes is missing from what comes back; the contour is right all the same."""

    def without_smallest(vertices, parts, sign, around):
        largest = max(parts, key=lambda part: np.ptp(vertices[part].reshape(-1, 3), axis=0).max())
        used, faces = np.unique(largest, return_inverse=True)
        return vertices[used], faces.reshape(-1, 3)

    monkeypatch.setattr(mend, "unite", without_smallest)
    with pytest.warns(PalpateWarning, match="points lie inside the union and not inside its bodies, or the reverse"):
        thing = MeshObject(*joined(CUBE, box(0.02, (0.04, 0.0, 0.2))))
    assert not thing.is_simple
    length = render(thing, Palm(0.4, 0.4), LEVEL, closed_contour(), device=device).length()
    assert length == pytest.approx([4 * 0.08 + 2 * 0.01], abs=1e-6)
