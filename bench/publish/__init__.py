"""How results become tables and pages, and are compared."""
