"""The pipeline: objects and hands in, contours, focal points and drives out."""
