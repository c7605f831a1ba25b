"""Files of focal points and drives: point lists of DOLPHIN, and frames."""
