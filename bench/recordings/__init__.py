"""How far patches are from recorded notes of the instruments that they model."""
