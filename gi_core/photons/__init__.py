"""Background photons: paths through the static part, traced once, and fixed-point sums of them."""
