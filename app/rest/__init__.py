"""Work at rest: static light, error measurements, references on disk, setting trials."""
