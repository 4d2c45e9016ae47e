"""A Scene at a sample rate becomes a Model and a State."""
