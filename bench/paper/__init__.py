"""The figures of the paper, and its iteration counts."""
