"""Measurements of the program: benchmarks, charts of error against time, the failure atlas."""
