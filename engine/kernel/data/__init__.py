"""Records of a model and of its state, and the axes of their arrays."""
