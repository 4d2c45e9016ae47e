"""Rendering of a block of samples: step by step, or in flights and in sleep."""
