"""Contour files as one HTML page that holds everything itself: to mail, or to publish."""
