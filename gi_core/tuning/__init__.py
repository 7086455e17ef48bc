"""Settings tried on a scene, and the error model fitted to the trials."""
