"""The Python interface: renderings that draw, save and show themselves, and players."""
