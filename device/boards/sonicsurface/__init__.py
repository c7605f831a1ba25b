"""UpnaLab's SonicSurface behind a serial adapter: link and model."""
