"""Settings for a scene, with the error and the cost that they predict."""
