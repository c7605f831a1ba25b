"""Many motions at once on one device: poses -> contours -> focal points -> what these come to, and wire bytes."""
