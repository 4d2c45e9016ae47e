"""Instruments: patches whose bodies and events are functions of the key that is played."""
