"""The ruler: contact schemes on the same problems, error against time against energy (docs/ruler.md)."""
