"""Scenes that tests, bench and guides share."""
