"""Frame times, and the report's tables."""
