"""Interactions, a file for each: connections, contacts, external forces, one-way drives."""
