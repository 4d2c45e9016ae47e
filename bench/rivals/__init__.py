"""The same scenes by other means."""
