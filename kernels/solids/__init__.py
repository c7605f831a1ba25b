"""What is made of objects before they are rendered: exact predicates, crossings, nesting, voxels, surfaces."""
