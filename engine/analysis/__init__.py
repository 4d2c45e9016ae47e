"""Analysis of sounds and of settings: features, errors, what accuracy costs, why a scene is silent."""
