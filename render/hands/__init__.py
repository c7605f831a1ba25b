"""What touches: planes of skin and skin meshes, of one hand or several."""
