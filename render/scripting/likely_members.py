"""What people ask a batch for by another library's word, and what it is called here."""

from typing import TYPE_CHECKING, Any, ClassVar


class LikelyMembers:
    """An unknown attribute's error names the member that is probably meant."""

    likely: ClassVar[dict[str, str]] = {}
    """Sentence by word."""

    if not TYPE_CHECKING:  # hidden from type checkers, which would take every name for one that there is

        def __getattr__(self, name: str) -> Any:
            """Raise AttributeError with the way out, as the name is not known."""
            hint = f": {self.likely[name]}" if name in self.likely else ""
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}{hint}", name=name, obj=self)


PICTURES = dict.fromkeys(
    ("plot", "draw", "render"), "figure(path) draws it, and a notebook shows a batch that ends a cell"
)
OF_BATCHES = {
    **PICTURES,
    **dict.fromkeys(("to_dataframe", "df", "dataframe", "to_frame"), "to_pandas() gives a table of poses"),
    "to_csv": "to_pandas().to_csv(path) writes a table",
    "to_numpy": "arrays() gives all arrays by name, batch[i] the polylines of a pose",
    **dict.fromkeys(("contours", "polylines", "paths"), "batch[i] gives the polylines of pose i"),
    **dict.fromkeys(("vertices", "xyz"), "points holds them, batch[i] those of pose i by polyline"),
    **dict.fromkeys(("time", "times", "t"), "motion.time has the times [s]"),
    **dict.fromkeys(("pose", "poses"), "motion.pose has the hand's poses"),
    **dict.fromkeys(("write", "export", "dump", "to_file", "to_hdf", "to_hdf5"), "save(path) writes a contour file"),
    **dict.fromkeys(("stream", "start", "emit"), "play(array) streams it"),
    **dict.fromkeys(("focal_points", "focus", "points_of_focus"), "sample() gives focal points"),
    **dict.fromkeys(("to_trimesh", "to_pyvista"), "the object has it; batch[i] are arrays of points"),
    **dict.fromkeys(("summary", "describe", "info", "stats"), "facts() gives the numbers"),
    **dict.fromkeys(("object", "mesh", "solid"), "scene.solid is the object that was rendered, facts() has its name"),
    "hand": "scene.hand is the hand that was rendered, facts() has its kind",
    "strategy": "scene.strategy is the strategy that was rendered, of a file ContourFile(path).strategy",
}
OF_FOCAL_POINTS = {
    **dict.fromkeys(("plot", "show", "draw"), "the batch's figure(path) draws contours; position and time are arrays"),
    **dict.fromkeys(("to_dataframe", "df", "to_frame", "to_xarray"), "to_pandas() gives a table"),
    "to_csv": "to_pandas().to_csv(path) writes a table",
    **dict.fromkeys(("times", "t"), "time has the times [s]"),
    **dict.fromkeys(("points", "xyz", "positions"), "position has the places [m]"),
    **dict.fromkeys(("play", "stream"), "the batch's play(array) streams them, or play_file(path) after save(path)"),
}
