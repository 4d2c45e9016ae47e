"""A block of all partitions of a scene, on one core or several."""
