"""The kernels of stages that weigh contours: by corners, by kind, by depth."""
