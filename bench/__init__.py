"""Measurements. `uv run python -m bench` runs them all and writes the tables in README.md and docs."""
