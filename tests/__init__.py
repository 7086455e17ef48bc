"""The tests: unit/ mirrors the packages, physics/ holds the solver against theory."""
