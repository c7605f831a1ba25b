"""Numbers of contours by pose, their sums over many poses, and random poses."""
