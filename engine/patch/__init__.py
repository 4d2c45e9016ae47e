"""TOML in; a Scene or located faults out."""
