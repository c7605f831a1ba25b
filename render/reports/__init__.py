"""Numbers and pictures of contour files and strategies."""
