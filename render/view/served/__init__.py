"""Pages that a server of this machine shows in its browser: contour files and sweeps' tables as they are on disk."""
