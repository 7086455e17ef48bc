"""One folder per package."""
