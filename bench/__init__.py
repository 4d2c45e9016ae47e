"""Measurements. `uv run python -m bench all` runs them all and writes the tables in README.md and docs."""
