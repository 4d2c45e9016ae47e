"""Assembly: a Scene and a sample rate give a Model and a State."""
