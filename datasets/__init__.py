"""Files on disk and things to render: contour files, hand motions, built-in objects."""
