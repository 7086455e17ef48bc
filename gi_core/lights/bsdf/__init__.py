"""Surface models, one per file."""
