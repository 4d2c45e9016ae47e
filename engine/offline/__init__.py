"""A scene rendered to an array."""
