"""The whole solver against theory: invariants, closed forms, statistics."""
