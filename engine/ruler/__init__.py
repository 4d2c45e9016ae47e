"""Problems of collision with reference solutions, and the score of a trajectory against them (docs/ruler.md)."""
