"""What people ask batches and focal points for by other libraries' words, and what it is called here."""

from typing import TYPE_CHECKING, Any

LIKELY = {
    "plot draw render show": "the batch's figure(path) draws contours, and a notebook shows a batch that ends a cell",
    "to_dataframe df dataframe to_frame to_csv": "to_pandas() gives a table, which to_csv(path) writes",
    "to_numpy": "arrays() of a batch gives all arrays by name, batch[i] the polylines of a pose",
    "contours polylines paths": "batch[i] gives the polylines of pose i",
    "points vertices xyz positions": "points of a batch, or position of focal points, has the places [m]",
    "time times t": "motion.time of a batch, or time of focal points, has the times [s]",
    "write export dump to_file to_hdf to_hdf5": "save(path) writes a contour file, or a point list of focal points",
    "play stream start emit": "the batch's play(array) streams it, play_file(path) what save(path) wrote",
    "focal_points focus points_of_focus": "sample() gives focal points",
    "summary describe info stats": "facts() gives the numbers",
    "object mesh solid hand strategy": "scene of a batch has solid, hand and strategy; facts() has their names",
}


class LikelyMembers:
    """An unknown attribute's error names the member that is probably meant."""

    if not TYPE_CHECKING:  # hidden from type checkers, which would take every name for one that there is

        def __getattr__(self, name: str) -> Any:
            """Raise AttributeError with the way out, as the name is not known."""
            hint = "".join(f": {way}" for words, way in LIKELY.items() if name in words.split())
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}{hint}", name=name, obj=self)
