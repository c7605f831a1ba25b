"""The live viewer: a page by viser that shows contour files and sweeps' tables as they are on disk."""
