"""Errors, and what they cost in time."""
