"""Frame times, sweeps, and the report's tables."""
