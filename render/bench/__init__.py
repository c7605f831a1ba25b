"""`palpate bench`: the speed of contours on this machine."""
