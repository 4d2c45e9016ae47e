"""Patches that sound without Python: as a library in C."""
