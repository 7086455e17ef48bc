"""One open scene: the solver's thread, settings, poses, history, warnings."""
