"""What loading found in a mesh, what it did, and what could be done: in one paragraph or as a table."""

from dataclasses import dataclass

ROOM = 1.06  # lengths are suggested with two digits, which may take a twentieth away


@dataclass(frozen=True)
class MeshReport:
    """What was found and what was done when a mesh was loaded."""

    triangles: int = 0
    """Triangles of the file."""
    vertices_welded: int = 0
    """Vertices merged into another one, which float32 cannot tell from it, or which is as close as was asked for."""
    faces_dropped: int = 0
    """Triangles left out: a corner twice, repeats, and walls (a triangle and its back) that bound no solid."""
    faces_flat: int = 0
    """Triangles of zero area that were taken out, and their neighbours cut where they had a corner."""
    faces_turned: int = 0
    """Triangles turned over so that neighbours agree."""
    bodies: int = 1
    """Connected surfaces, open ones too, before any were left out or united."""
    bodies_turned: int = 0
    """Bodies that were inside out."""
    bodies_hidden: int = 0
    """Bodies left out because they lie inside others, where they bound nothing."""
    bodies_flat: int = 0
    """Closed bodies left out because they lie in a plane and enclose nothing."""
    cavities: int = 0
    """Closed surfaces that face inwards, inside another body."""
    bodies_united: int = 0
    """Bodies that crossed or touched and were replaced by their union."""
    crossings_found: int = 0
    """Pairs of triangles that crossed or overlapped when the file was read; counting ends at some four million."""
    crossings: int = 0
    """Those of them that uniting did not resolve."""
    union_fault: str = ""
    """Why bodies that cross could not be united; empty if there was no need or it was done."""
    open_edges: int = 0
    """Edges with a triangle on one side only."""
    holes: int = 0
    """Rims: closed chains of such edges."""
    rim_longest: float = 0.0
    """Length of the longest rim, in the file's unit."""
    fill_closes: float = 0.0
    """Length of rim up to which filling holes leaves bodies that enclose something, in the file's unit; 0 for none."""
    weld_closes: float = 0.0
    """Distance within which merging vertices would close them all, in the file's unit; 0 if none was found."""
    holes_filled: int = 0
    """Holes closed because that was asked for."""
    sheet_faces: int = 0
    """Triangles of open surfaces that enclose nothing: drawn by OC, left out where a solid is asked for."""
    crossed_edges: int = 0
    """Edges where no choice of sides can agree (a surface with one side only)."""

    @property
    def closed(self) -> bool:
        """Whether inside and outside are defined everywhere."""
        return self.crossed_edges == 0 and (self.open_edges == 0 or self.sheet_faces > 0)

    def changes(self) -> list[str]:
        """What was changed, one phrase each."""
        dropped = f"{self.faces_dropped} triangles dropped (a corner twice, repeats, or walls with a back)"
        flat = f"{self.faces_flat} triangles of zero area taken out, their neighbours cut where they had a corner"
        phrases = {
            dropped: self.faces_dropped,
            flat: self.faces_flat,
            f"{self.holes_filled} holes filled": self.holes_filled,
            f"{self.faces_turned} triangles turned over to agree with their neighbours": self.faces_turned,
            f"{self.bodies_turned} of {self.bodies} bodies turned inside out (they faced inwards), "
            f"{self.cavities} are cavities": self.bodies_turned,
            f"{self.bodies_flat} flat bodies that enclose nothing left out": self.bodies_flat,
            f"{self.bodies_hidden} bodies inside others left out": self.bodies_hidden,
            f"{self.bodies_united} bodies that cross or touch united": self.bodies_united,
        }
        return [phrase for phrase, count in phrases.items() if count]

    def closing(self, scale: float) -> list[str]:
        """Options of loading that leave no edge open, one phrase each; scale: as for `faults`."""
        out = []
        if self.weld_closes:
            out.append(f"weld={ROOM * scale * self.weld_closes:.2g} merges vertices until no edge is open")
        if self.fill_closes:
            out.append(f"fill_holes={ROOM * scale * self.fill_closes:.2g} closes every hole")
        return out

    def faults(self, scale: float = 1.0) -> list[str]:
        """What is left that a user should know, one phrase each; scale: metres of the object as placed a unit."""
        out = []
        if self.crossings:
            why = f" ({self.union_fault})" if self.union_fault else ""
            regularised = "sections are regularised by winding number, pose by pose, which is slower"
            outcome = regularised if self.closed else "contours are drawn as cut, also where they lie inside"
            out.append(f"{self.crossings} pairs of triangles cross{why}: {outcome}")
        if self.crossed_edges:
            out.append(f"the surface has one side only ({self.crossed_edges} edges where no orientation agrees)")
        if self.open_edges:
            longest = f"the longest {scale * self.rim_longest:.3g} m long"
            out.append(f"{self.open_edges} open edges around {self.holes} holes, {longest}")
        if self.weld_closes:
            out.append(f"weld={scale * self.weld_closes:.2g} would close them all")
        if self.open_edges and self.crossings_found:
            out.append(f"{self.crossings_found} pairs of triangles cross or overlap, open surfaces among them")
        if self.sheet_faces:
            out.append(
                f"{self.sheet_faces} triangles of open surfaces enclose nothing: OC draws them, CC leaves them out"
            )
        return out
