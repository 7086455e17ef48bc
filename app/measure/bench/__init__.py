"""Frame times, their bounds, and the report's tables."""
