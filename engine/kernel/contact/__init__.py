"""The law of contacts, and the solvers of contact forces."""
