"""Surface models, one a file, of identical shape: eval, sample, pdf."""
