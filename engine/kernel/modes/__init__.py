"""Modes of bodies: how they move by themselves, and under forces that are known."""
